"""Views: which turns a prompt shows, and the numbers that describe it."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain
from typing import Any

from smartplay_tools.context.turns import Form, Turn
from smartplay_tools.types import Purpose, ToolSpec
from smartplay_tools.types.messages import Message, copy_of, text_of


@dataclass(slots=True)
class Selection:
    """Which turns a prompt shows: the run from `first` to `last`, and before it the pinned ones that are older."""

    pinned: tuple[int, ...]
    """The turns before `first` that stay: first turns, the latest with the newest observation, that with the notes."""
    first: int
    last: int
    oldest: int
    """Observations before this one are masked."""
    hidden: int | None = None
    """The pinned turn with the notes, of which every observation is masked."""
    words: int = 0
    """Replies of turns older than this step are bare."""
    anchors: int = 0
    """How many of the first turns stay; they stand before a summary."""
    pictures: int = 0
    """How many of the first pictures of the conversation are left out."""
    is_chosen: bool = False
    """Whether a custom strategy has chosen the turns; `pinned` are then all but the newest."""
    masked: frozenset[int] = frozenset()
    """Turns whose observations a custom strategy masks."""
    texts: Mapping[int, Form] = field(default_factory=dict)
    """The texts of a custom strategy, by the turn before which each stands."""
    first_whole: int = 0
    """The turn from which on every turn of the run is shown whole."""

    def __iter__(self) -> Iterator[int]:
        yield from self.pinned
        yield from range(self.first, self.last + 1)

    def __len__(self) -> int:
        return len(self.pinned) + self.last + 1 - self.first

    def oldest_of(self, turn: Turn) -> int:
        """Return the oldest observation that a turn of the selection may show."""
        is_hidden = turn.number == self.hidden or turn.number in self.masked
        return turn.step + 1 if is_hidden else self.oldest

    @property
    def front(self) -> int:
        """How many of the pinned turns stand before a summary."""
        return bisect_left(self.pinned, self.anchors) if self.anchors else 0

    def seen(self, turn: Turn) -> tuple[Form, ...]:
        """Return the messages of a turn as the selection shows them."""
        return turn.seen(self.oldest_of(turn), bare=turn.step < self.words, pictures=self.pictures)

    def forms(
        self, turns: Sequence[Turn], whole: Callable[[int, int], Iterable[Form]], summary: Form | None = None
    ) -> list[Form]:
        """Return the messages of the selected turns with the texts before them; `summary` is after the first turns.

        `whole` returns the messages of the turns from one to before another, with none of them masked.
        """
        shown: list[Sequence[Form]] = []
        changed = self.changed
        for number in (*self.pinned, *changed):
            if number in self.texts:
                shown.append((self.texts[number],))
            shown.append(self.seen(turns[number]))
        if summary is not None:
            shown.insert(self.front, (summary,))
        return [*chain.from_iterable(shown), *whole(changed.stop, self.last + 1)]

    @property
    def changed(self) -> range:
        """The turns of the run that may be shown in part."""
        return range(self.first, min(max(self.first, self.first_whole), self.last + 1))

    def masked_items(self, turn: Turn) -> list[int]:
        """Return the indices of the items of a turn that read as the marker."""
        return turn.masked(self.oldest_of(turn), self.pictures)

    @property
    def ranges(self) -> list[list[int]]:
        """The turns as a record holds them: ranges, first and last included."""
        if not self.is_chosen:
            run = [[self.first, self.last]] if self.last >= 0 else []
            return [*([index, index] for index in self.pinned), *run]
        return ranges_of(self)


@dataclass(slots=True)
class View:
    """The contents of a prompt, with the numbers of what it leaves out. It is not changed once it is made."""

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
    """Which turns the view shows."""
    forms: Sequence[Form] = field(repr=False)
    """The messages in the forms in which they are shown."""
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
    def asks_for_summary(self) -> bool:
        """Whether words are asked for, a summary or the answer to a compactor's question, and not a move."""
        return self.purpose != "play"

    @property
    def messages(self) -> list[Message]:
        """Head and turns, in chronological order, as copies."""
        return [copy_of(form.message) for form in self.forms]

    @property
    def masked_results(self) -> tuple[tuple[int, int], ...]:
        """(turn, item) of every result in the view that reads as the marker."""
        chosen = self.selection
        turns = [self.turns[index] for index in (*chosen.pinned, *chosen.changed)]
        return tuple((turn.number, at) for turn in turns for at in chosen.masked_items(turn))


@dataclass(frozen=True)
class Head:
    """The first messages of every prompt, with tools and priming, for one state of the manual."""

    messages: tuple[Message, ...]
    tokens: int
    """Tokens of messages, tools and priming."""
    tools: tuple[ToolSpec, ...] = ()

    @cached_property
    def forms(self) -> list[Form]:
        """The messages; examples of calls keep their ids, which are the head's own."""
        return [Form(message) for message in self.messages]


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
