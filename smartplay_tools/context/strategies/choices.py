"""Choices: what a custom strategy is shown of the past, and what it returns.

The past is read lazily, so what a strategy does not look at costs nothing, and given as copies, so a strategy cannot
change it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol, overload, runtime_checkable

from smartplay_tools.context.turns import Form, Turn
from smartplay_tools.types.messages import Message, copy_of


@dataclass(frozen=True, slots=True)
class PastTurn:
    """A turn, as a strategy sees it: a reply and everything up to the next one."""

    number: int
    """Its number, by which a choice names it; the first is 0."""
    turn: Turn = field(repr=False)
    tokens: int
    """Its tokens as it would be shown now, old observations masked."""
    masked_tokens: int
    """Its tokens with all its observations masked."""
    is_pinned: bool
    """Whether it is shown in any case; its tokens are not part of the room."""
    forms: Sequence[Form] = field(repr=False)

    @property
    def step(self) -> int:
        """The newest observation at its end."""
        return self.turn.step

    @property
    def shows(self) -> tuple[int, ...]:
        """The observations that its results show, in their order."""
        return self.turn.shows

    @property
    def tools(self) -> tuple[str, ...]:
        """The names of the tools that it calls, in the order of its calls."""
        return self.turn.tools

    @property
    def errors(self) -> int:
        """How many of its calls were refused."""
        return self.turn.errors

    @property
    def rewards(self) -> tuple[float, ...]:
        """The rewards of the steps that it has played, in their order."""
        return self.turn.rewards

    @property
    def messages(self) -> list[Message]:
        """Its messages as they would be shown now, as copies."""
        return [copy_of(form.message) for form in self.forms]


class PastTurns(Sequence[PastTurn]):
    """The turns so far, each made when it is read."""

    def __init__(self, count: int, make: Callable[[int], PastTurn]) -> None:
        self._count, self._make = count, make
        self.reads = 0
        """How many turns were read."""

    def __len__(self) -> int:
        return self._count

    @overload
    def __getitem__(self, at: int) -> PastTurn: ...

    @overload
    def __getitem__(self, at: slice) -> Sequence[PastTurn]: ...

    def __getitem__(self, at: int | slice) -> PastTurn | Sequence[PastTurn]:
        places = range(self._count)[at]
        if isinstance(places, int):
            self.reads += 1
            return self._make(places)
        self.reads += len(places)
        return [self._make(place) for place in places]


@dataclass(frozen=True, slots=True)
class Past:
    """Everything up to the end of a turn, which the next prompt may show."""

    turns: Sequence[PastTurn]
    """Every turn, the newest last."""
    step: int
    """The newest observation."""
    oldest: int
    """Observations before this one are masked, whatever is chosen."""
    pinned: tuple[int, ...]
    """The turns that are shown in any case: the newest, the latest that shows the newest observation, the notes."""
    text_tokens: Callable[[str], int]
    """Returns the tokens that a text of a choice takes."""


@dataclass(frozen=True, slots=True)
class Choice:
    """What a prompt shows of the past, in addition to the pinned turns and in the order of the conversation."""

    turns: Iterable[int] = ()
    """The numbers of turns, in any order; pinned ones may be among them."""
    masked: Iterable[int] = ()
    """Those of them that are shown with all their observations masked. Pinned turns cannot be."""
    texts: Mapping[int, str] = field(default_factory=dict)
    """Texts by the number of a shown turn; each is a user message before that turn."""


@runtime_checkable
class Strategy(Protocol):
    """A way to deal with the past that anybody can add: a class with this one method.

    An object belongs to one episode and may remember. Its constructor takes the options that its name has
    (`FILE.py:CLASS:turns=3`). A choice must follow from what the strategy was given: no clock, no randomness of its
    own.
    """

    def choose(self, past: Past, room: int | None) -> Choice:
        """Return what the next prompt to play shows; called once for each, from the first turn on.

        `room` is the tokens that `prompt_tokens` leaves after the head and the pinned turns; None without a cap.
        """
        ...
