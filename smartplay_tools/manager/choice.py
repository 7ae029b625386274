"""Choice: which units of a reading a prompt shows, and how, by rules that know the reading and the room alone.

A prompt is a run of units up to the newest, and before it those that are pinned: the newest words of the user, the
operator's newest instruction, what the caller marks, first units, and the unit of the last message. Where the run
begins is decided as in games (`context.newest`), and steps decide what is too old for what.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Any

from smartplay_tools.context.grid import block_of, jump_of, moved_on_grid
from smartplay_tools.context.newest import newest_run
from smartplay_tools.manager.counting import PICTURE_LEFT, RESULT_LEFT, MessageCounter
from smartplay_tools.manager.forms import Content, Given, MessageForm, with_text, without_pictures
from smartplay_tools.manager.reading import Part, Reading, Unit
from smartplay_tools.manager.settings import Settings

__all__ = ["Choice", "Shown", "TooLongError", "as_first_shown", "beginnings"]


class TooLongError(Exception):
    """What cannot be left out is too long: `pins` and `newest` are its tokens."""

    def __init__(self, pins: int, newest: int) -> None:
        super().__init__(pins, newest)
        self.pins, self.newest = pins, newest


def beginnings(reading: Reading, settings: Settings, room: float, first: int) -> list[int]:
    """Return the units after the first with which runs of a conversation begin as it grows, up to one of them.

    They are the units of the grid, whichever of them a prompt has begun with: a function of the conversation alone.
    """
    places, steps = reading.sums.whole, reading.steps
    found = {first}
    if not math.isinf(room):
        block = block_of(settings.slack, room)
        found |= {bisect_left(places, number * block) for number in range(1, places[first] // block + 1)}
    if settings.history is not None and not settings.masks:
        jump = jump_of(settings.slack, settings.history)
        found |= {bisect_left(steps, step) for step in range(jump, steps[first] + 1, jump)}
    return sorted(unit for unit in found if 0 < unit <= first)


@dataclass(slots=True)
class Shown:
    """A message of a prompt."""

    part: Part
    message: Given
    shorter: int | None = None
    """Its tokens where it is shorter than it was first shown."""
    change: str | None = None
    """What was changed of it: masked, trimmed, elided or cut."""

    @property
    def tokens(self) -> int:
        """Its tokens."""
        return self.part.cost.whole if self.shorter is None else self.shorter


class Choice:
    """The units of one prompt, and how each is shown; runs and pins are counted by running sums."""

    def __init__(
        self, reading: Reading, settings: Settings, newest: int | None, room: float, *, needs_user: bool
    ) -> None:
        """Choose for a room in tokens.

        `newest` is the number of the last message, None if it is in no unit; `needs_user` says that no words of a user
        stand before the units. What cannot be left out raises a `TooLongError` if it does not fit.
        """
        self._reading, self._sums, self._last = reading, reading.sums, len(reading.units) - 1
        steps, pictures = reading.steps, reading.sums.pictures
        step = steps[-1] if steps else 0
        self._masked = self._trimmed = self._elided = 0
        """Units before these show no results, replies with their calls alone, or no pictures."""
        if settings.history is not None:
            self._masked = bisect_left(steps, moved_on_grid(step, settings.history, settings.slack))
        if settings.own_words is not None:
            self._trimmed = bisect_left(steps, moved_on_grid(step, settings.own_words, settings.slack))
        if settings.newest_pictures is not None:
            left_out = moved_on_grid(pictures[-1] - 1, settings.newest_pictures - 1, settings.slack)
            self._elided = bisect_left(pictures, left_out)
        self._late = reading.unit_of(newest)
        """The unit of the last message, which is not masked: its result may have come late."""
        self._extra = 0
        """The tokens by which that unit is longer for it."""
        if self._last >= 0 and self._late < self._masked:
            one = self._late, self._late + 1
            self._extra = self._run(*one, masked=0) - self._run(*one)
        self.first, self.pinned, self.pins = 0, list[int](), 0
        """The first unit of the run, the units before it that stay, and the tokens of these."""
        self._squeezed: Mapping[int, tuple[Sequence[Any], int]] = {}
        """By parts of the newest unit: results that are shorter than their cap, and the message's tokens."""
        if self._last >= 0:
            self._choose(settings, room, needs_user=needs_user)

    def _run(self, first: int, stop: int, masked: int | None = None) -> int:
        """The tokens of the units from one to before another, as they are shown."""
        sums, masked = self._sums, self._masked if masked is None else masked

        def words(unit: int) -> int:
            return sums.whole[unit] - sums.results[unit]

        at = min(max(self._trimmed, first), stop)
        tokens = sums.trimmed[at] - sums.trimmed[first] + words(stop) - words(at)
        at = min(max(masked, first), stop)
        then = min(max(self._elided, at), stop)
        tokens += sums.masked[at] - sums.masked[first] + sums.unpictured[then] - sums.unpictured[at]
        return tokens + sums.results[stop] - sums.results[then]

    def _choose(self, settings: Settings, room: float, *, needs_user: bool) -> None:
        last, reading = self._last, self._reading
        always = {*reading.pinned, self._late, *reading.users[-1:], *reading.instructions[-1:]}
        always |= {*reading.compactions[-1:]}
        firsts = range(min(settings.first_turns, last) + 1)
        kept = bisect_right(firsts, room, key=lambda number: self._need(last, sorted({*always, *range(number)}))) - 1
        pinned = sorted({*always, *range(max(kept, 0))})
        sums = [0, *accumulate(self._run(number, number + 1) for number in pinned)]

        def tokens(first: int) -> int:
            return self._extra + self._run(first, last + 1) + sums[bisect_left(pinned, first)]

        lowest = 0 if settings.masks else min(self._masked, last)
        first = newest_run(tokens, room, self._sums.whole, block_of(settings.slack, room), lowest)
        if needs_user and not bisect_left(pinned, first) and reading.units[first].kind == "reply":
            first = next((number for number in reading.users if number > first), first)
        self.first, self.pinned = first, pinned[: bisect_left(pinned, first)]
        self.pins = sums[len(self.pinned)]
        if tokens(first) > room:  # not even the newest unit fits
            newest = self._run(last, last + 1)
            spare = room - tokens(last) + newest
            self._squeezed = squeezed(reading.units[last], spare, reading.form, reading.counter)
            if not self._squeezed:
                raise TooLongError(tokens(last) - newest, newest)

    def _need(self, first: int, pinned: Sequence[int]) -> int:
        """The tokens of a run to the newest unit, and of pinned units before it."""
        before = pinned[: bisect_left(pinned, first)]
        return self._extra + self._run(first, self._last + 1) + sum(self._run(n, n + 1) for n in before)

    def shown(self) -> Iterator[Shown]:
        """Yield the messages after the head."""
        form, units = self._reading.form, self._reading.units
        for number in (*self.pinned, *range(self.first, len(units))):
            unit = units[number]
            has_results = any(part.cost.is_result for part in unit.parts)
            for at, part in enumerate(unit.parts):
                if part.cost.is_result:
                    yield self._result(number, part, self._squeezed.get(at) if number == self._last else None, form)
                elif unit.kind == "reply" and has_results and number < self._trimmed:
                    if (shorter := form.trimmed(part.message)) is not None:
                        yield Shown(part, shorter, part.cost.trimmed, "trimmed")
                else:
                    yield Shown(part, part.message)

    def _result(self, number: int, part: Part, squeezed: tuple[Sequence[Any], int] | None, form: MessageForm) -> Shown:
        contents = form.results(part.message)
        if number < self._masked and number != self._late:
            return self._changed(part, [RESULT_LEFT] * len(contents), part.cost.masked, "masked", form)
        if squeezed is not None:
            return self._changed(part, squeezed[0], squeezed[1], "cut", form)
        tokens, change = part.cost.whole, None
        if part.cost.cut is not None:
            contents, change = [c if text is None else with_text(c, text) for c, text in _cuts(part, contents)], "cut"
        if part.cost.pictures and number < self._elided:
            contents = [without_pictures(content, PICTURE_LEFT) for content in contents]
            tokens, change = part.cost.unpictured, "elided"
        return Shown(part, part.message) if change is None else self._changed(part, contents, tokens, change, form)

    @staticmethod
    def _changed(part: Part, contents: Sequence[Any], tokens: int, change: str, form: MessageForm) -> Shown:
        message = form.with_results(part.message, contents)
        assert message is not None
        return Shown(part, message, tokens, change)


def squeezed(
    unit: Unit, room: float, form: MessageForm, counter: MessageCounter
) -> dict[int, tuple[Sequence[Any], int]]:
    """Return, by parts, results of a unit cut to one length, the longest with which the unit fits into a room.

    Without results, or if they are not enough, nothing is returned.
    """
    contents = {at: form.results(part.message) for at, part in enumerate(unit.parts) if part.cost.is_result}
    shown = {
        at: [Content.of(content).text if cut is None else cut for content, cut in _cuts(unit.parts[at], each)]
        for at, each in contents.items()
    }
    sizes = [counter.text(text) for texts in shown.values() for text in texts]
    rest = sum(part.cost.whole for part in unit.parts) - sum(sizes)
    if not sizes or rest > room:
        return {}
    lengths = range(max(sizes) + 1)
    share = bisect_right(lengths, room - rest, key=lambda length: sum(min(size, length) for size in sizes)) - 1
    made: dict[int, tuple[Sequence[Any], int]] = {}
    for at, each in contents.items():
        texts = [
            text if counter.text(text) <= share else counter.cut(Content.of(content).text, share)
            for content, text in zip(each, shown[at], strict=True)
        ]
        tokens = unit.parts[at].cost.whole + sum(map(counter.text, texts)) - sum(map(counter.text, shown[at]))
        made[at] = [with_text(content, text) for content, text in zip(each, texts, strict=True)], tokens
    return made


def as_first_shown(part: Part, form: MessageForm) -> Given:
    """Return a message with its results cut to their cap."""
    if part.cost.cut is None:
        return part.message
    contents = [c if cut is None else with_text(c, cut) for c, cut in _cuts(part, form.results(part.message))]
    message = form.with_results(part.message, contents)
    assert message is not None
    return message


def _cuts(part: Part, contents: Sequence[Any]) -> Iterator[tuple[Any, str | None]]:
    """The contents of a message's results, each with its text if that was cut."""
    return zip(contents, part.cost.cut or [None] * len(contents), strict=True)
