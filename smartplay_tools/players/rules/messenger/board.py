"""MESSENGER's board as tables of places, distances and movements, and the parser of observations (`SeenEntities`).

All places are in half cells. The rule player considers thousands of places at every step, so everything that depends
only on two places is precomputed. There are two numberings. A *cell* is one of the 100 on which we can be. A *spot* is
a place as one number, 64 for a half cell to the east and 1 for one to the south, so that the difference of two spots
identifies their offset and can be used as an index.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.int64]
Floats = NDArray[np.float32]
Truths = NDArray[np.bool_]

ACTIONS = ("Move North", "Move South", "Move West", "Move East", "Do Nothing")
SIDES = ((0, -1), (0, 1), (-1, 0), (1, 0))
"""North, south, west and east, in the order of the actions."""

CHASER, FLEEING, IMMOVABLE = range(3)
MOVEMENTS = ("chaser", "fleeing", "immovable")

CELLS = 10
WIDTH = 2 * CELLS - 1
"""The number of places from border to border."""
PLACES = WIDTH * WIDTH

EAST = 64
"""The difference of spots for a half cell to the east; to the south it is 1."""
NOWHERE = -30 * EAST
"""The spot of things that are not on the board, so far away that they touch nothing."""
OFFSETS = 96 * EAST
"""The number of differences of spots, shifted so that none is negative."""
SHIFT = 32 * EAST
DRAWS = 12
"""A mover's step is drawn by a number below this, which 2, 3 and 4 divide."""

DIRECTIONS = ("you", "north", "south", "west", "east", "north-west", "north-east", "south-west", "south-east")


def sight_code(distance: int, direction: str) -> int:
    """Return the code of a distance and a direction in `BoardTables.shown`."""
    return distance * len(DIRECTIONS) + DIRECTIONS.index(direction)


@dataclass(frozen=True)
class BoardTables:
    """The tables by cell and place. The first axis is our cell, if there is one."""

    next_cell: Ints
    """Action, cell -> the cell after it; at a border, the same."""
    shown: Ints
    """Cell, place -> the code of the distance and direction of a thing there."""
    distance: Ints
    """Cell, place -> the distance that is shown."""
    apart: Truths
    """Cell, place -> whether a thing there does not touch us."""
    shares: Floats
    """Chaser or fleeing, cell, direction, place -> the probability that a thing there goes in that direction: four
    sides, or it is kept in its place by the border."""
    whole: Truths
    """Place -> whether it lies on a whole cell, as everything does at the start."""
    spot_of_cell: Ints
    spot_of_place: Ints

    def advance(self, belief: Floats, movement: int, cells: Ints) -> Floats:
        """Move things for a tick: belief[..., case, place], where `cells` are our cells in each case.

        Steps over the border have probability 0 in that direction, so whole rows can be shifted at once.
        """
        if movement == IMMOVABLE:
            return belief
        share = self.shares[movement][cells]
        after: Floats = belief * share[:, 4]
        after[..., :-1] += (belief * share[:, 0])[..., 1:]
        after[..., 1:] += (belief * share[:, 1])[..., :-1]
        after[..., :-WIDTH] += (belief * share[:, 2])[..., WIDTH:]
        after[..., WIDTH:] += (belief * share[:, 3])[..., :-WIDTH]
        return after


@functools.cache
def board() -> BoardTables:
    """Return the tables, which are computed once."""
    cell_x, cell_y = (axis.ravel() for axis in np.indices((CELLS, CELLS)))
    x, y = (axis.ravel() for axis in np.indices((WIDTH, WIDTH)))
    east, south = x - 2 * cell_x[:, None], y - 2 * cell_y[:, None]
    cells_east, cells_south = east // 2, south // 2
    distance = abs(cells_east) + abs(cells_south)
    direction = np.array([[0, 4, 3], [2, 8, 7], [1, 6, 5]])[np.sign(cells_south), np.sign(cells_east)]
    steps = [(cell_x + dx, cell_y + dy) for dx, dy in (*SIDES, (0, 0))]
    stays = np.arange(CELLS * CELLS)
    return BoardTables(
        next_cell=np.array(
            [
                np.where(np.isin(to_x, cell_x) & np.isin(to_y, cell_y), to_x * CELLS + to_y, stays)
                for to_x, to_y in steps
            ]
        ),
        shown=distance * len(DIRECTIONS) + direction,
        distance=distance,
        apart=np.maximum(abs(east), abs(south)) > 1,
        shares=_shares(east, south, x, y),
        whole=(x % 2 == 0) & (y % 2 == 0),
        spot_of_cell=2 * cell_x * EAST + 2 * cell_y,
        spot_of_place=x * EAST + y,
    )


def _shares(east: Ints, south: Ints, x: Ints, y: Ints) -> Floats:
    """Return the probability of each direction for each mover. Movers ignore the border, which keeps them in place."""
    nearer = np.stack([south > 0, south < 0, east > 0, east < 0], axis=1)
    open_to = nearer.sum(axis=1, keepdims=True)
    chasing = np.where(open_to == 0, 0.25, nearer / np.maximum(open_to, 1))
    fleeing = ~nearer / (4 - open_to)
    outside = np.array([y == 0, y == WIDTH - 1, x == 0, x == WIDTH - 1])
    ways = np.stack([chasing, fleeing])
    kept = np.where(outside, ways, 0).sum(axis=2, keepdims=True)
    return np.concatenate([np.where(outside, 0, ways), kept], axis=2).astype(np.float32)


@dataclass(frozen=True)
class Offsets:
    """The tables by the offset from a thing to us: the difference of the spots plus `SHIFT`."""

    step: Ints
    """(Movement * DRAWS + draw) * OFFSETS + offset -> the change of the thing's spot."""
    touching: Truths
    """Whether two squares overlap: half a cell's distance, also diagonally, is a contact."""
    distance: Ints
    """In half cells, along the axes."""
    gap: Ints
    """In half cells, along the longer axis."""
    next_spot: Ints
    """Action * OFFSETS + SHIFT + our spot -> our spot after it."""
    on_board: Truths
    """Spot + SHIFT -> whether it is on the board."""


@functools.cache
def offsets() -> Offsets:
    """Return the tables, which are computed once."""
    number = np.arange(OFFSETS) - SHIFT
    south = (number + EAST // 2) % EAST - EAST // 2
    east = (number - south) // EAST
    on_board = np.isin(east, range(WIDTH)) & np.isin(south, range(WIDTH))
    steps = np.zeros((len(MOVEMENTS), DRAWS, OFFSETS), dtype=np.int64)
    side_of = np.array([-1, 1, -EAST, EAST])
    for column, (dx, dy) in enumerate(zip(np.sign(east), np.sign(south), strict=True)):
        nearer = [side for side, (sx, sy) in zip(side_of, SIDES, strict=True) if sx * dx > 0 or sy * dy > 0]
        farther = [side for side in side_of if side not in nearer]
        for movement, ways in ((CHASER, nearer or list(side_of)), (FLEEING, farther)):
            steps[movement, :, column] = [ways[draw * len(ways) // DRAWS] for draw in range(DRAWS)]
    moves = (-2, 2, -2 * EAST, 2 * EAST, 0)
    return Offsets(
        step=steps.ravel(),
        touching=(abs(east) <= 1) & (abs(south) <= 1),
        distance=abs(east) + abs(south),
        gap=np.maximum(abs(east), abs(south)),
        next_spot=np.array([np.where(np.roll(on_board, -move), number + move, number) for move in moves]).ravel(),
        on_board=on_board,
    )


@dataclass(frozen=True)
class SeenEntities:
    """The content of an observation."""

    action: str | None
    """The action before it; None at the start."""
    has_message: bool
    things: Mapping[str, tuple[int, str]]
    """Name -> distance in cells, direction."""

    @classmethod
    def of(cls, text: str) -> SeenEntities:
        """Parse an observation."""
        action = re.search(r"^You took action (.+)\.$", text, flags=re.MULTILINE)
        things = re.findall(r"^- (\w+) (\d+) steps (?:to your |with )([\w-]+)$", text, flags=re.MULTILINE)
        return cls(
            action[1] if action else None,
            "already have the message" in text,
            {name: (int(distance), direction) for name, distance, direction in things},
        )
