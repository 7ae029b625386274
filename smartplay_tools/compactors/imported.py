"""Imported compactors: the compaction of other projects by name, each with its code unchanged.

Each is a class of the adapter of its framework, which converts messages with the adapter's functions and calls what the
framework's own agents call. `ImportedCompactor` is what these classes share: the framework's questions to a model
become questions of the compactor, our counter takes the place of its tokenizer, and the versions of its packages are in
the record. Their names are listed in `context.strategies.custom`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

from smartplay_tools.context.compaction import ContextOverflowError, GivenHistory, Questions, Room, asked
from smartplay_tools.context.tokens.o200k import o200k_base
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.types import Prompt, Reply
from smartplay_tools.types.messages import Message, pictures_of

__all__ = ["ImportedCompactor"]

SHARE = 0.8
"""How full the room for the conversation is when a compactor acts that was not told at how many tokens."""


@dataclass(eq=False)
class ImportedCompactor:
    """The compaction of a framework, for one episode.

    It is also the player behind the framework's class for models: a prompt that it is asked to reply to is a question.
    """

    tokens: int | None = None
    """Where it begins to act, in tokens of the conversation; None for four fifths of the room that this has."""

    name: str = field(default="compactor", init=False)
    ask: Callable[[Sequence[Message]], Message] = field(init=False)
    """Asks a model, and waits for its reply."""
    persistent: ClassVar[bool] = False
    packages: ClassVar[tuple[str, ...]] = ()
    """The packages of the framework, whose versions are recorded. With tiktoken among them, its `o200k_base` is the
    vocabulary that ships with this package, so nothing is downloaded."""
    overflow: ClassVar[Any] = ContextOverflowError
    """Makes what the framework takes for a full context."""

    def make(self) -> Any:
        """Return the framework's object."""
        raise NotImplementedError

    def rewrite(self, history: GivenHistory) -> Any:
        """Return the messages that the framework makes of a history; blocking or asynchronous."""
        raise NotImplementedError

    @cached_property
    def made(self) -> Any:
        """The framework's object, made for the first prompt."""
        if "tiktoken" in self.packages:
            from tiktoken import registry  # no dependency of those that do not count with it

            registry.ENCODINGS.setdefault("o200k_base", o200k_base())
        return self.make()

    def compact(self, history: GivenHistory, room: Room) -> Questions[list[Message]]:
        """Have the framework rewrite the history, and yield what it asks a model."""
        if any(map(pictures_of, history)):
            raise InvalidArgumentError(f"{type(self).__name__} rewrites words; leave out observation and pictures.")
        self.room = room

        def work(ask: Callable[[Sequence[Message]], Message]) -> Any:
            self.ask = ask
            return self.rewrite(history)

        return asked(work, overflow=self.overflow)

    def reply(self, prompt: Prompt) -> Reply:
        """Answer a prompt of the framework's class for models."""
        return Reply(self.ask(prompt.messages))

    @property
    def limit(self) -> int:
        """The tokens of the conversation at which it begins to act."""
        if self.tokens is None and self.room.tokens is None:
            raise InvalidArgumentError("A compactor needs prompt_tokens, or its option tokens=N, to know when to act.")
        return self.tokens or int(SHARE * (self.room.tokens or 0))

    def is_full(self, messages: Iterable[Message]) -> bool:
        """Whether messages are longer than their room."""
        return self.room.tokens is not None and self.count(messages) > self.room.tokens

    def count(self, messages: Iterable[Message]) -> int:
        """Return the tokens of messages as the window counts them."""
        return self.room.count([*messages])

    def count_tokens(self, text: str) -> int:
        """Return the tokens of a text, for frameworks that count no messages."""
        return self.count([{"role": "user", "content": text}]) - self.count([{"role": "user", "content": ""}])

    def new_of(self, history: GivenHistory) -> Sequence[Message]:
        """Return the messages that have come since the last call, for frameworks that keep the conversation."""
        seen, self._seen = getattr(self, "_seen", 0), len(history)
        return history[seen:]
