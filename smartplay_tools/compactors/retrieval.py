"""Retrieval: compactors that write turns into a memory as they leave, and show what the memory returns for the newest.

A memory has two methods, `write(turn)` and `read(query) -> text`, so that a product for memories is compared with
others by what a game needs. How many turns stay and how long the text is are decided here, alike for all.
`WordMemory` is our own: BM25, as `recall` has it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from itertools import accumulate, islice, pairwise, takewhile
from typing import ClassVar

from smartplay_tools.context.compaction import Room
from smartplay_tools.context.strategies.documents import Documents
from smartplay_tools.types.messages import Message, calls_of, text_of

__all__ = ["MOST_TURNS", "MemoryCompactor", "WordMemory", "text_of_turn"]

MOST_TURNS = 20
"""How many of the best turns our memories return; the cap on the text leaves fewer."""


class MemoryCompactor(ABC):
    """A memory as a compactor, for one episode.

    Turns stay while they fit beside the memory's text. Those that leave are written, oldest first. What `read` returns
    for the words of the newest turn is shown in a user message before the turns that stay: the first lines that fit.

    Arguments:
        tokens: the cap on this message.
    """

    persistent: ClassVar[bool] = False
    packages: ClassVar[tuple[str, ...]] = ()
    """The packages of the memory, whose versions are recorded."""

    def __init__(self, tokens: int = 300) -> None:
        self.tokens = tokens
        self._written = 0

    @abstractmethod
    def write(self, turn: Sequence[Message]) -> None:
        """Take a turn that leaves: a reply and what follows it until the next."""

    @abstractmethod
    def read(self, query: str) -> str:
        """Return what the memory has about a text, the most important lines first."""

    def compact(self, history: Sequence[Message], room: Room) -> list[Message]:
        """Write the turns that leave, and show what is read."""
        starts = [at for at, message in enumerate(history) if message["role"] == "assistant"]
        turns = [history[start:end] for start, end in pairwise([*starts, len(history)])]
        head = history[: len(history) - sum(map(len, turns))]
        while room.tokens is not None and self._written < len(turns) - 1:
            shown = [message for turn in turns[self._written :] for message in turn]
            if room.count([*head, *shown]) <= room.tokens - self.tokens:
                break
            self.write(turns[self._written])
            self._written += 1
        if not self._written:
            return list(history)
        remembered = self._shortened(self.read(text_of_turn(turns[-1])), room)
        return [*head, *remembered, *(message for turn in turns[self._written :] for message in turn)]

    def _shortened(self, text: str, room: Room) -> list[Message]:
        """Return a message with the first lines of a text that fit; none if there are none."""
        beginnings = accumulate(text.splitlines(), "{}\n{}".format)
        messages: Iterator[Message] = ({"role": "user", "content": beginning} for beginning in beginnings)
        fitting = [*takewhile(lambda message: room.count([message]) <= self.tokens, messages)]
        return fitting[-1:]


class WordMemory(MemoryCompactor):
    """Our own memory: BM25 over the words of each turn."""

    def __init__(self, tokens: int = 300) -> None:
        super().__init__(tokens)
        self._turns = Documents("Turn ")

    def write(self, turn: Sequence[Message]) -> None:
        """Index the words of the turn."""
        self._turns.add(len(self._turns.steps), f":\n{text_of_turn(turn)}")

    def read(self, query: str) -> str:
        """Return the turns with the words of the query, by their scores, best first; of equal ones the newer."""
        return "\n".join(self._turns[number] for number in islice(self._turns.best(query, ()), MOST_TURNS))


def text_of_turn(turn: Sequence[Message]) -> str:
    """Return a turn as text: the words of its messages, and its calls with their arguments."""
    return "\n".join(line for message in turn for line in _lines(message) if line)


def _lines(message: Message) -> list[str]:
    calls = (call["function"] for call in calls_of(message))
    return [text_of(message), *(f"{call['name']}({call['arguments']})" for call in calls)]
