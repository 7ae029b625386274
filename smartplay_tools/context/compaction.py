"""Compactors: strategies that rewrite the messages of a conversation, as the compaction of agent frameworks does.

A `Compactor` is given the messages after the system message and returns those that take their place. To ask a model it
yields the messages of a question, and is sent the reply. What it returns is checked, counted and cut by the window
(`context.compacting`), so no prompt is over its cap. `asked` runs code that does not yield, such as a framework's.
"""

from __future__ import annotations

import asyncio
import contextvars
import threading
from collections import UserList
from collections.abc import Awaitable, Callable, Generator, Iterable, Sequence
from dataclasses import dataclass, field
from queue import SimpleQueue
from typing import Any, Protocol, TypeAlias, TypeVar, runtime_checkable

from smartplay_tools.errors import ContextOverflowError
from smartplay_tools.types.messages import Message

__all__ = ["Compactor", "ContextOverflowError", "GivenHistory", "Questions", "Room", "asked"]

T = TypeVar("T")

Questions: TypeAlias = Generator[Sequence[Message], Message, T]
"""Yields the messages of questions, is sent the replies, and returns something."""


class GivenHistory(UserList[Message]):
    """The messages that a compactor is given: copies, made when one of them is first needed.

    It is used like a list, can be changed, and may be returned.
    """

    def __init__(
        self, messages: Iterable[Message] = (), *, length: int = 0, copies: Callable[[], list[Message]] | None = None
    ) -> None:
        if copies is None:
            super().__init__(messages)
        else:
            self._length, self._copies = length, copies

    def __getattr__(self, name: str) -> Any:
        if name != "data":
            raise AttributeError(name)
        self.data = self._copies()
        return self.data

    @property
    def is_untouched(self) -> bool:
        """Whether nobody has looked at a message, so that none can have changed."""
        return "data" not in self.__dict__

    def __len__(self) -> int:
        return self._length if self.is_untouched else len(self.data)

    __copy__ = UserList.copy


@dataclass(frozen=True)
class Room:
    """What a compactor can know about the space that its messages have."""

    tokens: int | None
    """The tokens that `prompt_tokens` leaves after system message and tool schemas; None without a cap."""
    question_tokens: int | None
    """The cap on the prompt of a question; None without one."""
    last: int | None
    """The tokens of the latest prompt to play, as a provider would report them; None before the first."""
    count: Callable[[Sequence[Message]], int] = field(repr=False)
    """Returns the tokens of messages as the window counts them; a message that it was given counts as it is sent."""
    head: int = 0
    """The tokens of system message and tool schemas, which every prompt has beside its messages."""


@runtime_checkable
class Compactor(Protocol):
    """A way to rewrite the past that anybody can add: a class with this one method.

    An object belongs to one episode and may remember. Its constructor takes the options that its name has
    (`FILE.py:CLASS:tokens=900`). What it returns must follow from what it was given: no clock, no randomness. A class
    with `persistent = False` is always given the whole conversation; any other, which is the default, what it returned
    last and the messages since.
    """

    def compact(self, history: GivenHistory, room: Room) -> Any:
        """Return the messages that take the place of `history`, or a generator of questions that returns them.

        It is called once for each prompt to play. A question is a list of messages; it is answered with an assistant
        message, or with a `ContextOverflowError` if it is longer than `room.question_tokens`.
        """
        ...


class _ClosedError(BaseException):
    """Nobody answers any more; `except Exception` does not catch it, so that a thread that asks ends."""


def asked(
    work: Callable[[Callable[[Sequence[Message]], Message]], T | Awaitable[T]],
    *,
    overflow: Callable[[str], Exception] = ContextOverflowError,
) -> Questions[T]:
    """Run code in a thread as a generator of questions, and return what it returns; for `Compactor.compact`.

    Once the generator is closed, every question raises an exception that `except Exception` does not catch, so the
    thread ends. Code that neither asks nor returns cannot be ended.

    Arguments:
        work: blocking or asynchronous code. Its argument is a function that asks a question and waits for the reply.
        overflow: makes the exception that this code takes for a full context, from a sentence.
    """
    turns: SimpleQueue[tuple[SimpleQueue[Any] | None, Any, BaseException | None]] = SimpleQueue()
    lock, closed = threading.Lock(), threading.Event()

    def ask(messages: Sequence[Message]) -> Message:
        reply: SimpleQueue[Any] = SimpleQueue()
        with lock:
            if closed.is_set():
                raise _ClosedError
            turns.put((reply, messages, None))
        answer = reply.get()
        if isinstance(answer, BaseException):
            raise answer
        return answer  # type: ignore[no-any-return]

    def run() -> None:
        try:
            made = work(ask)
            turns.put((None, asyncio.run(_awaited(made)) if isinstance(made, Awaitable) else made, None))
        except BaseException as error:  # it is raised where the questions are answered
            turns.put((None, None, error))

    context = contextvars.copy_context()
    threading.Thread(target=context.run, args=(run,), name="smartplay-tools compactor", daemon=True).start()
    reply: SimpleQueue[Any] | None = None
    try:
        while True:
            reply, made, error = turns.get()
            if error is not None:
                raise error
            if reply is None:
                return made  # type: ignore[no-any-return]
            try:
                answer: Any = yield made
            except ContextOverflowError as refused:
                answer = overflow(str(refused))
            reply.put(answer)
            reply = None
    finally:
        with lock:
            closed.set()
        waiting = [reply]
        while not turns.empty():
            waiting.append(turns.get()[0])
        for each in waiting:
            if each is not None:
                each.put(_ClosedError())


async def _awaited(made: Awaitable[T]) -> T:
    return await made
