"""The time that a run is expected to take from now on.

A run's speed is not one number: episodes differ in length a hundredfold, players answer in a millisecond or a minute,
and near the end a few long episodes are played alone. So the seconds of a call are measured for each cell, from the
time that its episodes were under way. The time left is then at least that of the longest episode, and at least that of
all the work divided by the episodes that are played at a time. No schedule that keeps all places busy takes more than
the sum of the two (Graham 1966), so the larger one is right within a factor of two if the estimated lengths are right.
"""

from __future__ import annotations

import math
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from smartplay_tools.episode.budgets import resolve
from smartplay_tools.episode.cells import most_calls
from smartplay_tools.episode.config import CellConfig
from smartplay_tools.records.spent import Spent

Clock = Callable[[], float]

ENOUGH = 5
"""Replies of each running episode from which on a cell has its own pace."""


@dataclass(frozen=True)
class Growing:
    """An episode that is being played."""

    replies: int
    rest: float = math.inf
    """The most replies that its budget still allows."""


@dataclass(frozen=True)
class CellWork:
    """How far the episodes of a cell are."""

    player: str
    """The player with its options."""
    group: str
    """Players of one group are played at the same time; groups follow one another."""
    most: int
    """Replies of the longest episode that the game and the budget allow."""
    waiting: int
    finished: Sequence[int]
    """The replies of each finished episode."""
    running: Sequence[Growing]
    calls: int
    """Replies of all attempts, each counted once."""

    @property
    def rests(self) -> list[float]:
        """The replies that each running episode is expected to take from now on."""
        if not self.finished:
            return [min(max(0, self.most - episode.replies), episode.rest) for episode in self.running]
        mean = sum(self.finished) / len(self.finished)
        return [
            min(
                max(0, self.most - episode.replies),
                episode.rest,
                mean - episode.replies if episode.replies < mean else self._censored,
            )
            for episode in self.running
        ]

    @property
    def length(self) -> float:
        """The replies that a waiting episode is expected to take."""
        if not self.finished:
            return min(self.most, max((episode.replies + episode.rest for episode in self.running), default=math.inf))
        # As long as most are still running, those that have finished are the short ones.
        is_early = len(self.finished) < len(self.running)
        return self._censored if is_early else sum(self.finished) / len(self.finished)

    @property
    def _censored(self) -> float:
        """The mean length if the running episodes are counted with what they have played."""
        played = sum(self.finished) + sum(episode.replies for episode in self.running)
        return min(self.most, played / len(self.finished))


class TimeLeft:
    """Estimates the time left of a run, from looks at its progress."""

    def __init__(self, clock: Clock = time.monotonic) -> None:
        self._clock = clock
        self._began: float | None = None
        self._looked = 0.0
        self._first: list[int] = []
        self._spent = Spent()
        self._running: list[int] = []
        self._busy: list[float] = []
        self._places: dict[str, int] = {}

    def look(self, cells: Sequence[CellWork], spent: Spent, caps: Mapping[str, Any]) -> float | None:
        """Return the seconds that are left; None before the first reply since the first look."""
        now, running = self._clock(), [len(cell.running) for cell in cells]
        if self._began is None or len(cells) != len(self._first):
            self._began, self._first, self._spent = now, [cell.calls for cell in cells], spent
            self._busy, self._running, self._places = [0.0] * len(cells), running, {}
        elapsed, self._looked = now - max(self._looked, self._began), now
        for at, count in enumerate(running):
            self._busy[at] += elapsed * (count + self._running[at]) / 2
        self._running = running
        at_once = Counter[str]()
        for cell, count in zip(cells, running, strict=True):
            at_once[cell.group] += count
        for group, count in at_once.items():
            self._places[group] = max(count, self._places.get(group, 0))
        paces = self._paces(cells)
        if all(pace is None for pace in paces):
            return None
        left = sum(self._group(group, cells, paces) for group in self._places)
        return min([left, *self._until_caps(spent, caps)])

    def _paces(self, cells: Sequence[CellWork]) -> list[float | None]:
        """The seconds of a call in each cell: of the cell if it has enough calls, else of its player or its group."""
        keys = [(str(at), f"player {cell.player}", f"group {cell.group}") for at, cell in enumerate(cells)]
        calls, busy, least = Counter[str](), defaultdict[str, float](float), Counter[str]()
        for at, cell in enumerate(cells):
            for key in keys[at]:
                calls[key] += cell.calls - self._first[at]
                busy[key] += self._busy[at]
                least[key] += ENOUGH * len(cell.running)
        paces = {key: busy[key] / count for key, count in calls.items() if count > 0}
        chosen = [next((key for key in own if key in paces and calls[key] >= least[key]), own[-1]) for own in keys]
        return [paces.get(key) for key in chosen]

    def _group(self, group: str, cells: Sequence[CellWork], paces: Sequence[float | None]) -> float:
        own = [
            (cell, pace) for cell, pace in zip(cells, paces, strict=True) if cell.group == group and pace is not None
        ]
        places = max(1, self._places[group])
        has_room = sum(len(cell.running) for cell, _ in own) < places
        bounds = [_longest(own), sum(_work(cell, pace) for cell, pace in own) / places]
        for player in {cell.player for cell, _ in own} if has_room else ():
            mine = [(cell, pace) for cell, pace in own if cell.player == player]
            running = sum(len(cell.running) for cell, _ in mine)
            if running and any(cell.waiting for cell, _ in mine):  # it is held back by its own limit
                bounds.append(sum(_work(cell, pace) for cell, pace in mine) / running)
        return max(bounds)

    def _until_caps(self, spent: Spent, caps: Mapping[str, Any]) -> Iterable[float]:
        """The seconds until a cap of the run is reached, at the rate so far."""
        assert self._began is not None
        elapsed = self._looked - self._began
        for name in ("tokens", "cost"):
            cap, used, before = caps.get(name), getattr(spent, name), getattr(self._spent, name)
            if cap is not None and used is not None and before is not None and used > before:
                yield max(0.0, cap - used) * elapsed / (used - before)


def _work(cell: CellWork, pace: float) -> float:
    return pace * (sum(cell.rests) + cell.waiting * (cell.length if cell.waiting else 0.0))


def _longest(cells: Sequence[tuple[CellWork, float]]) -> float:
    waiting = [cell.length * pace for cell, pace in cells if cell.waiting]
    return max([*waiting, *(rest * pace for cell, pace in cells for rest in cell.rests)], default=0.0)


def most_replies(cell: CellConfig) -> int:
    """Return the replies of the longest episode that a cell's game and its cap on calls allow."""
    most, cap = most_calls(cell), resolve(cell.budget, cell.spec, 0).tool_calls
    return most if cap is None or cell.protocol == "paper" else min(most, cap)


def rest_of_tokens(cell: CellConfig, spent: Spent, peak: int) -> float:
    """Return the replies for which an episode's cap on tokens still has room, if its prompts go on as they grew."""
    cap = cell.budget.episode_tokens
    if cap is None or not spent.replies or not peak:
        return math.inf
    left = max(0, cap - spent.tokens)
    reply = spent.reply_tokens / spent.replies
    slope = max(0.0, 2 * (peak - spent.prompt_tokens / spent.replies) / spent.replies)
    top = cell.budget.prompt_tokens or math.inf
    now = peak + reply
    if not slope:
        return left / now
    until_top = max(0.0, (top - peak) / slope)
    if until_top < math.inf and (grown := until_top * (now + slope * until_top / 2)) < left:
        return until_top + (left - grown) / (top + reply)
    return (math.sqrt(now * now + 2 * slope * left) - now) / slope
