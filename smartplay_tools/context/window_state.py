"""The state of a window after a number of turns: what is old, what is pinned, and what any run of turns then costs."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field

from smartplay_tools.context.strategies.base import Summary
from smartplay_tools.context.token_index import TokenIndex
from smartplay_tools.context.turns import Form
from smartplay_tools.context.view import Head, Selection


@dataclass(slots=True)
class WindowState:
    """The facts after a number of turns, from which the selection is made."""

    index: TokenIndex
    turns: int
    """How many turns there are."""
    step: int
    """t, the newest observation shown so far."""
    oldest: int
    """b: older observations are masked."""
    boundary: int
    """The first turn that is not older than `oldest`: the only one that can be partly too old."""
    saved: int
    """The tokens saved by masking the boundary's old observations; negative if the marker is longer than they are."""
    newest: int | None
    """o, the latest turn that shows observation t."""
    head: Head
    words: int = 0
    """w: replies of turns older than this step are bare."""
    spoken: int = 0
    """The first turn that is not older than `words`: replies before it are bare."""
    first_whole: int = 0
    """The first turn from which on no observation is masked, no reply is bare and no picture is left out."""
    pictures: int = field(default=0, init=False)
    """p: how many of the first pictures are left out."""
    pictured: int = field(default=0, init=False)
    """The first turn with a picture after these: the only one of which only some can be left out."""
    left_out: int = field(default=0, init=False)
    """The tokens that leaving these out saves in `pictured`, unless it is the boundary or before it."""
    anchors: int = field(default=0, init=False)
    """a: how many of the first turns stay."""
    notes: int | None = field(default=None, init=False)
    """q, the turn with the notes, while it is pinned as that and nothing else."""

    @classmethod
    def after(
        cls, index: TokenIndex, oldest: int, newest: int | None, head: Head, words: int = 0, pictures: int = 0
    ) -> WindowState:
        """Return the state after all turns of an index, without notes."""
        turns = index.turns
        boundary = first_whole = index.first_from(oldest)
        saved = 0
        if boundary < len(turns) and (pictures or not turns[boundary].is_young(oldest)):
            saved, first_whole = index.saved(turns[boundary], oldest, pictures), boundary + 1
        spoken = index.first_from(words) if words else 0
        step = turns[-1].step if turns else 0
        first_whole = max(first_whole, spoken)
        state = cls(index, len(turns), step, oldest, boundary, saved, newest, head, words, spoken, first_whole)
        if pictures:
            state.pictures, state.pictured = pictures, index.first_pictured(pictures)
            state.first_whole = max(state.first_whole, state.pictured + 1)
            if boundary < state.pictured < len(turns):
                state.left_out = index.saved(turns[state.pictured], 0, pictures)
        return state

    def pin_first(self, most: int, room: float) -> None:
        """Pin as many of the first turns, at most `most`, as fit into a room beside the pins."""
        least, numbers = self.tokens(self.last), range(1, min(most, self.last) + 1)
        self.anchors = bisect_right(numbers, room - least, key=self._anchors_tokens)

    @property
    def last(self) -> int:
        """The newest turn, -1 before the first."""
        return self.turns - 1

    @property
    def _newest_tokens(self) -> int:
        return 0 if self.newest is None else self.run(self.newest, self.newest + 1)

    @property
    def _notes_tokens(self) -> int:
        return 0 if self.notes is None else self.masked(self.notes)

    def masked(self, turn: int) -> int:
        """Tokens of a turn with every observation masked."""
        sums = self.index.masked
        return sums[turn + 1] - sums[turn] - self.index.spoken(turn, min(turn + 1, self.spoken))

    def run(self, first: int, stop: int) -> int:
        """Tokens of the turns from `first` to before `stop`, as they are shown: without what is too old."""
        whole = self.index.whole
        if first >= self.first_whole:
            return whole[stop] - whole[first]
        masked, boundary = self.index.masked, self.boundary
        if first > boundary:
            tokens = whole[stop] - whole[first]
        elif stop <= boundary:
            tokens = masked[stop] - masked[first]
        else:
            tokens = masked[boundary] - masked[first] + whole[stop] - whole[boundary] - self.saved
        if self.pictures:
            low = max(first, boundary + 1)
            tokens -= self.index.unpictured(low, min(stop, self.pictured))
            tokens -= self.left_out if low <= self.pictured < stop else 0
        return tokens if first >= self.spoken else tokens - self.index.spoken(first, min(stop, self.spoken))

    def tokens(self, first: int) -> int:
        """V: tokens of head, the run from `first` to the newest turn, and the pinned turns before it."""
        total = self.head.tokens + self.run(first, self.turns)
        if self.newest is not None and self.newest < first:
            total += self._newest_tokens
        if self.notes is not None and self.notes < first:
            total += self._notes_tokens
        return total + self._anchors_tokens(min(self.anchors, first)) if self.anchors else total

    def _anchors_tokens(self, stop: int) -> int:
        """Tokens of the first turns to before `stop`, without those that are pinned for another reason."""
        return self.run(0, stop) - sum(self.run(index, index + 1) for index in self._pinned_before(stop))

    def _pinned_before(self, stop: int) -> set[int]:
        """The turns before `stop` that are pinned for another reason than that they are among the first."""
        return {index for index in (self.newest, self.notes) if index is not None and index < stop}

    def selected(self, first: int) -> Selection:
        """Return the selection whose run begins at `first`."""
        pinned = self._pinned_before(first)
        hidden = self.notes if self.notes in pinned else None
        if self.anchors:
            pinned.update(range(min(self.anchors, first)))
        facts = hidden, self.words, self.anchors, self.pictures
        return Selection(tuple(sorted(pinned)), first, self.last, self.oldest, *facts, first_whole=self.first_whole)

    def selection_tokens(self, chosen: Selection) -> int:
        """Tokens of head and the selected turns."""
        tokens = self.head.tokens + self.run(chosen.first, chosen.last + 1)
        for index in chosen.pinned:
            tokens += self._notes_tokens if index == chosen.hidden else self.run(index, index + 1)
        return tokens

    def visible(self, chosen: Selection) -> int:
        """How many observations a selection shows without a gap up to the newest.

        Observations of first turns before the run are not counted, except in the latest turn that shows the newest.
        """
        turns: Sequence[int] = range(max(chosen.first, self.boundary), chosen.last + 1)
        if self.newest in chosen.pinned and self.newest != chosen.hidden:
            turns = [self.newest]
        for number in turns:
            turn = self.index.turns[number]
            is_whole = number >= self.first_whole
            shown = turn.shows if is_whole else [form.step for form in chosen.seen(turn) if form.step is not None]
            if shown:
                return self.index.turns[chosen.last].step + 1 - shown[0]
        return 0


@dataclass(slots=True)
class Contents:
    """What a prompt holds: a selection of the turns of a state, the summary, and the question for another."""

    state: WindowState
    selection: Selection
    summary: Summary | None = None
    question: Form | None = None
    forms: Sequence[Form] = field(init=False)
    """The messages after the head."""

    def __post_init__(self) -> None:
        chosen, index, summary = self.selection, self.state.index, None if self.summary is None else self.summary.form
        shown = chosen.forms(index.turns, index.forms, summary)
        self.forms = shown if self.question is None else [*shown, self.question]
