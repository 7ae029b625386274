"""Selections and views: what a prompt shows of a conversation, and the prompt that is made of it.

A message is shown at a *level*: whole, elided (without its picture), trimmed (a reply with its calls alone), masked (a
marker in place of the observation), or it is gone. The built-in rule, a strategy that chooses and a compactor that
rewrites all return a `Selection`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Any, TypeAlias

from smartplay_tools.context.turns import Form, Turn
from smartplay_tools.types import Purpose, ToolSpec
from smartplay_tools.types.messages import Message, copy_of, text_of

Piece: TypeAlias = "range | Form"
"""A row of the conversation's messages by their numbers, or a text that stands before turns or in their place."""


@dataclass(frozen=True, slots=True)
class Selection:
    """What a prompt shows of a conversation: rows of its messages and texts, in this order, and their levels."""

    turns: Sequence[range]
    """The turns of which it shows messages; the last row is the run up to the newest."""
    pieces: Sequence[Piece] = ()
    """The messages and texts; all other messages are gone."""
    oldest: int = 0
    """Observations before this one are masked."""
    trimmed_before: int = 0
    """Replies of turns older than this step are trimmed."""
    elided: int = 0
    """How many of the first pictures of the conversation are elided."""
    masked: frozenset[int] = frozenset()
    """Turns of which a custom strategy has every observation masked."""
    pinned: int | None = None
    """The turn that a strategy has pinned, of which every observation is masked; None without one, and in the run."""
    facts: Mapping[str, Any] = field(default_factory=dict)
    """What else the record of its prompt needs."""

    def __iter__(self) -> Iterator[int]:
        return chain.from_iterable(self.turns)

    def __len__(self) -> int:
        return sum(map(len, self.turns))

    def is_masked(self, turn: int) -> bool:
        """Whether every observation of a turn is masked, however young it is."""
        return turn == self.pinned or turn in self.masked

    def oldest_of(self, turn: Turn) -> int:
        """Return the oldest observation that a turn of the selection may show."""
        return turn.step + 1 if self.is_masked(turn.number) else self.oldest

    def seen(self, turn: Turn) -> tuple[Form, ...]:
        """Return the messages of a turn, each at its level."""
        return turn.seen(self.oldest_of(turn), trimmed_before=self.trimmed_before, elided=self.elided)

    def masked_items(self, turn: Turn) -> list[int]:
        """Return the indices of the items of a turn that read as the marker."""
        return turn.masked_items(self.oldest_of(turn), self.elided)

    @property
    def ranges(self) -> list[list[int]]:
        """The turns as a record holds them: ranges, first and last included."""
        return [[row.start, row.stop - 1] for row in self.turns if row.stop]


@dataclass(slots=True)
class View:
    """A prompt, with the numbers of what it leaves out. It is not changed once it is made."""

    tools: tuple[ToolSpec, ...]
    tokens: int
    """Budget tokens of the whole prompt: tools, messages, priming."""
    shown_steps: int
    """How many observations are visible; of a prompt to play, they reach back from the current one without gaps."""
    dropped_turns: int
    """How many turns the prompt leaves out, summarised ones included."""
    prefix_tokens: int
    """Tokens of the messages at the beginning that are equal in the view before the latest turn."""
    selection: Selection
    """What the view shows of the conversation."""
    forms: Sequence[Form] = field(repr=False)
    """The messages in the forms in which they are shown."""
    head: Sequence[Form] = field(default=(), repr=False)
    """Those of them that are the head."""
    turns: Sequence[Turn] = field(default=(), repr=False)
    """All turns of the conversation."""
    purpose: Purpose = "play"
    """What the prompt asks for."""
    text_tokens: int = 0
    """The part of `tokens` that a custom strategy has written."""
    summaries: int = 0
    """How many summaries there have been."""
    facts: Mapping[str, Any] = field(default_factory=dict)
    """What else the record needs of the prompt."""

    @property
    def messages(self) -> list[Message]:
        """Head and turns, in chronological order, as copies."""
        return [copy_of(form.message) for form in self.forms]

    @property
    def masked_results(self) -> tuple[tuple[int, int], ...]:
        """(turn, item) of every result in the view that reads as the marker."""
        return tuple((turn.number, at) for turn in self._aged for at in self.selection.masked_items(turn))

    @property
    def _aged(self) -> Iterator[Turn]:
        """The turns that may be shown in part: of a row nothing is masked after the first turn that is young."""
        chosen = self.selection
        is_by_age = not (chosen.masked or chosen.elided or chosen.pinned is not None)
        for row in chosen.turns:
            for number in row:
                turn = self.turns[number]
                yield turn
                if is_by_age and turn.step >= chosen.oldest:
                    break


def ranges_of(numbers: Iterable[int]) -> list[list[int]]:
    """Return ascending numbers as ranges, first and last included."""
    ranges: list[list[int]] = []
    for number in numbers:
        if ranges and ranges[-1][1] == number - 1:
            ranges[-1][1] = number
        else:
            ranges.append([number, number])
    return ranges


def numbers_in(ranges: Iterable[Sequence[int]]) -> Iterator[int]:
    """Yield the numbers of ranges, first and last included."""
    return (number for first, last in ranges for number in range(first, last + 1))


def with_manual(head: Sequence[Message], manual: str) -> list[Message]:
    """Return the head with the manual as the last part of its system message."""
    at = next(index for index, message in enumerate(head) if message["role"] in ("system", "developer"))
    system = head[at].copy()
    system["content"] = f"{text_of(system)}\n\n{manual}"
    return [*head[:at], system, *head[at + 1 :]]
