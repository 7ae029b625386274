"""The probable places of everything in MESSENGER, inferred from the visible observations.

An observation gives distances and directions, not places; it hides half a cell, and of two things with the same name it
shows the nearer. For every cell on which we may have been when the visible window began, and for every thing in the
manual, the probability of each place is computed exactly through the window: things move by the rules, and places that
do not fit an observation are excluded. Of two things with the same name, one is shown and the other is hidden, at least
as far away; every pattern of shown and hidden is followed. The result is a number of *cases*: complete situations, all
equally likely.
"""

from __future__ import annotations

import functools
import random
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from smartplay_tools.players.rules.messenger.board import (
    ACTIONS,
    CELLS,
    IMMOVABLE,
    MOVEMENTS,
    NOWHERE,
    WIDTH,
    BoardTables,
    Floats,
    Ints,
    SeenEntities,
    Truths,
    board,
    sight_code,
)
from smartplay_tools.players.rules.messenger.casts import Cast, Part

CASES = 100
"""The number of cases that are drawn. Twice as many take twice the time and do not improve the score."""

THINGS = ("enemy", "message's decoy", "goal's decoy", "goal", "message")
ENEMY, MESSAGE_DECOY, GOAL_DECOY, GOAL, MESSAGE = range(len(THINGS))

SEEN, HIDDEN = 0, 1

Track = NDArray[np.float32]
"""Pattern, case of our path, place -> probability. The bits of a pattern, oldest view first, are seen or hidden."""


@dataclass(frozen=True)
class Cases:
    """Equally likely situations. The last axis is the case."""

    cell: Ints
    """Our cell."""
    spots: Ints
    """Thing -> its place."""
    movements: Ints
    """Thing -> its movement."""
    cast: Ints
    """The index of the cast."""
    hidden: Truths
    """Thing -> whether it is on the board but hidden, because the other thing of its name is nearer."""


def believe(weighted: Sequence[tuple[float, Cast]], views: Sequence[SeenEntities], count: int = CASES) -> Cases | None:
    """Return the cases that fit the views, or None if there are none."""
    tables = board()
    paths = _paths(tables, views)
    if not len(paths[0]):
        return None
    window = _Window(tables, views, paths)
    weights = np.array([weight * window.likelihood(cast) for weight, cast in weighted])
    if not weights.any():
        return None
    return _draw(window, [cast for _, cast in weighted], weights, count)


def _paths(tables: BoardTables, views: Sequence[SeenEntities]) -> list[Ints]:
    """Return our cell at each view, in every case in which everything that was seen is on the board."""
    paths = [np.arange(CELLS * CELLS)]
    for view in views[1:]:
        paths.append(tables.next_cell[ACTIONS.index(view.action)][paths[-1]] if view.action else paths[-1])
    possible = np.ones(len(paths[0]), dtype=bool)
    for path, view in zip(paths, views, strict=True):
        for shown in view.things.values():
            possible &= (tables.shown[path] == sight_code(*shown)).any(axis=1)
    return [path[possible] for path in paths]


class _Window:
    """The visible views, and the tracks of the things that may move through them."""

    def __init__(self, tables: BoardTables, views: Sequence[SeenEntities], paths: Sequence[Ints]) -> None:
        self.tables, self.views, self.paths = tables, views, paths
        self.apart = [tables.apart[path] for path in paths]
        self._before = _before_the_window(starts=views[0].action is None)
        self._tracks: dict[tuple[str, Part], Track] = {}
        self._sums: dict[tuple[str, Part], Floats] = {}

    def track(self, name: str, part: Part) -> Track:
        """Return the track of a thing; the role matters only for the message."""
        key = name, Part("message" if part.role == "message" else "", part.movement)
        if key not in self._tracks:
            masks = [self._masks(index, name, part) for index in range(len(self.views))]
            track = self._before[part.movement][self.paths[0]] * masks[0]
            for mask, path in zip(masks[1:], self.paths, strict=False):
                track = self.tables.advance(track, part.movement, path)
                track = (track[:, None] * mask).reshape(-1, *mask.shape[1:])
            self._tracks[key] = track
        return self._tracks[key]

    def _masks(self, index: int, name: str, part: Part) -> Truths:
        """Return the places of a thing at a view: those if it is the one that is seen, and those if it is hidden."""
        shown, path, apart = self.views[index].things.get(name), self.paths[index], self.apart[index]
        if part.role == "message" and self.views[index].has_message:
            # It is gone, and was at our cell when we took it.
            took = index > 0 and not self.views[index - 1].has_message
            return np.stack([np.zeros_like(apart), ~apart if took else np.ones_like(apart)])
        if shown is None:
            return np.zeros((2, *apart.shape), dtype=bool)
        seen = (self.tables.shown[path] == sight_code(*shown)) & apart
        return np.stack([seen, (self.tables.distance[path] >= shown[0]) & apart])

    def patterns(self, name: str, parts: tuple[Part, ...]) -> Floats:
        """Return pattern of the first part, case of our path -> likelihood."""
        first = self._sum(name, parts[0])
        if len(parts) == 2:
            both: Floats = first * self._sum(name, parts[1])[::-1]  # one is seen, the other hidden
            return both
        hidden = [parts[0].role == "message" and view.has_message for view in self.views]
        only = np.zeros_like(first)
        pattern = int("".join(str(int(bit)) for bit in hidden), 2)
        only[pattern] = first[pattern]
        return only

    def _sum(self, name: str, part: Part) -> Floats:
        key = name, part
        if key not in self._sums:
            self._sums[key] = self.track(name, part).sum(axis=-1)
        return self._sums[key]

    def likelihood(self, cast: Cast) -> Floats:
        """Return the likelihood of each case of our path if this is the cast."""
        likelihood: Floats = np.ones(len(self.paths[0]), dtype=np.float32)
        for name, parts in cast.items():
            if any(name in view.things for view in self.views) or parts[0].role == "message":
                likelihood = likelihood * self.patterns(name, parts).sum(axis=0)
            else:
                likelihood = likelihood * 0
        return likelihood


def _draw(window: _Window, cast_list: Sequence[Cast], weights: NDArray[np.float64], count: int) -> Cases:
    """Draw cases by their probabilities: always the same cases, spread evenly over casts and paths."""
    tables = window.tables
    cumulated = np.cumsum(weights.ravel())
    chosen = np.searchsorted(cumulated, (np.arange(count) + 0.5) / count * cumulated[-1])
    cast, path = np.divmod(np.minimum(chosen, weights.size - 1), weights.shape[1])
    spots = np.full((len(THINGS), count), NOWHERE)
    movements = np.full((len(THINGS), count), IMMOVABLE)
    hidden = np.zeros((len(THINGS), count), dtype=bool)
    chance = _chance(count)
    has_message = window.views[-1].has_message
    for number in np.unique(cast):
        rows = np.flatnonzero(cast == number)
        for column, (name, parts) in enumerate(cast_list[number].items()):
            likelihoods = window.patterns(name, parts)[:, path[rows]]
            pattern = _drawn(likelihoods.T, chance[column, rows])
            for at, part in enumerate(parts):
                if part.role == "message" and has_message:
                    continue
                track = window.track(name, part)
                bits = pattern if at == 0 else len(track) - 1 - pattern
                place = _drawn(track[bits, path[rows]], chance[3 + 2 * column + at, rows])
                thing = _thing(parts, part)
                spots[thing, rows] = tables.spot_of_place[place]
                movements[thing, rows] = part.movement
                hidden[thing, rows] = bits % 2 == HIDDEN
    return Cases(window.paths[-1][path], spots, movements, cast, hidden)


def _thing(parts: tuple[Part, ...], part: Part) -> int:
    if part.role == "message":
        return MESSAGE
    if part.role == "goal":
        return GOAL
    return {"enemy": ENEMY, "message": MESSAGE_DECOY, "goal": GOAL_DECOY}[parts[0].role]


def _drawn(weights: NDArray[np.floating], chance: NDArray[np.float64]) -> Ints:
    """Draw one column in each row."""
    cumulated = np.cumsum(weights, axis=1)
    above: Truths = cumulated > (chance * cumulated[:, -1])[:, None]
    drawn: Ints = above.argmax(axis=1)
    return drawn


@functools.cache
def _chance(count: int) -> NDArray[np.float64]:
    draw = random.Random(0)
    return np.array([[draw.random() for _ in range(count)] for _ in range(9)])


CORNERED, AT_BORDER = 0.64, 0.30
"""The places of fleeing things in games of the training split, from the seventh step on."""
CLOSER = 3.0
"""How much more often a chaser is at a place than at one that is a cell farther away, in the same games."""
ANYWHERE = 0.15
"""The probability that a mover is not yet at one of the places where movers mostly are."""


@functools.cache
def _before_the_window(*, starts: bool) -> tuple[Floats, ...]:
    """Return movement -> cell, place -> the prior probability of the place if we are on that cell.

    At the start everything is on a whole cell. Later, chasers are close behind us, and fleeing things have come to a
    border and mostly on to a corner, where they stay whether or not we are near.
    """
    tables = board()
    cells = _normal((tables.apart & tables.whole).astype(np.float32))
    if starts:
        return (cells,) * len(MOVEMENTS)
    anywhere = _normal(tables.apart.astype(np.float32))
    chaser = _normal(np.where(tables.apart, CLOSER ** -tables.distance.astype(np.float32), np.float32(0)))
    x, y = (axis.ravel() for axis in np.indices((WIDTH, WIDTH)))
    borders = np.isin(x, (0, WIDTH - 1)).astype(int) + np.isin(y, (0, WIDTH - 1))
    share = np.array([1 - CORNERED - AT_BORDER, AT_BORDER, CORNERED]) / np.bincount(borders)
    fleeing = _normal((tables.apart * share[borders]).astype(np.float32))
    movers = ((1 - ANYWHERE) * belief + ANYWHERE * anywhere for belief in (chaser, fleeing))
    return (*movers, cells)


def _normal(beliefs: Floats) -> Floats:
    normal: Floats = beliefs / beliefs.sum(axis=1, keepdims=True)
    return normal
