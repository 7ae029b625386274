"""The generation of a world: its ground and its first creatures, from one seed.

Crafter visits the cells one by one, column by column, first for the ground and then for creatures, and draws a number
wherever a rule needs one. For nearly all cells, the noise alone determines whether a number is drawn. The rules below
therefore work on whole arrays, and only the draws that may succeed are processed one after the other.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from smartplay_tools.games.crafter import facts
from smartplay_tools.games.crafter.noise import Points
from smartplay_tools.games.crafter.stream import Stream

Flags = NDArray[np.bool_]

CELLS = facts.AREA * facts.AREA
CENTER = facts.AREA // 2
MOST_DRAWS = 3 * CELLS
"""No cell asks for more than three draws in both passes together."""

_X, _Y = (
    a.ravel().astype(np.float64) for a in np.meshgrid(np.arange(facts.AREA), np.arange(facts.AREA), indexing="ij")
)
FROM_CENTER = np.sqrt((_X - CENTER) ** 2 + (_Y - CENTER) ** 2)
"""The distance of each cell from the player's first place."""

FIELDS = {
    "start": (_X / 3, _Y / 3, 8),
    "water": (_X / 15, _Y / 15, 3),
    "water detail": (_X / 5, _Y / 5, 3),
    "mountain": (_X / 15, _Y / 15, 0),
    "mountain detail": (_X / 5, _Y / 5, 0),
    "cave": (_X / 7, _Y / 7, 6),
    "horizontal tunnel": (2 * _X / 3, _Y / 5 / 3, 7),
    "vertical tunnel": (_X / 5 / 3, 2 * _Y / 3, 7),
    "coal": (_X / 8, _Y / 8, 1),
    "iron": (_X / 6, _Y / 6, 2),
    "lava": (_X / 5, _Y / 5, 6),
    "sand": (_X / 9, _Y / 9, 4),
    "tree": (_X / 7, _Y / 7, 5),
}
"""The noise fields by name, as coordinates: cells divided by the size of the features, and the field's layer."""


class Terrain(NamedTuple):
    """A new world: the material of each cell (x * 64 + y) and the creatures, (kind, cell), in the order of creation."""

    ground: NDArray[np.uint8]
    creatures: list[tuple[int, int]]


@functools.cache
def points() -> Points:
    """The points of all fields; their geometry is computed once per process."""
    columns = [np.concatenate([np.broadcast_to(field[axis], CELLS) for field in FIELDS.values()]) for axis in range(3)]
    return Points(*(column.astype(np.float64) for column in columns))


def generate(stream: Stream) -> Terrain:
    """Draw a world from the stream, which takes exactly as many numbers as in Crafter."""
    noise = dict(zip(FIELDS, points().values(stream.below(2**31 - 1)).reshape(-1, CELLS), strict=True))
    draws = Draws(stream.peek(MOST_DRAWS))
    ground, tunnels = _ground(noise, draws)
    creatures = _creatures(ground, tunnels, draws)
    stream.uniforms(draws.used)
    return Terrain(ground, creatures)


class Draws:
    """Numbers that were drawn ahead, and how many of them the rules have used."""

    def __init__(self, numbers: NDArray[np.float64]) -> None:
        self.used = 0
        self._numbers = numbers

    def take(self, asks: list[tuple[Flags, float]]) -> list[tuple[int, int]]:
        """Make the draws of every cell, in order, until one of them is above its threshold.

        `asks` are pairs of (which cells draw, threshold). Returns the successes as (cell, which ask).
        """
        waiting = np.stack([asking for asking, _ in asks], axis=1)
        thresholds = [threshold for _, threshold in asks]
        events = np.flatnonzero(waiting).tolist()
        width, at = len(asks), self.used
        numbers = self._numbers[at : at + len(events)]
        # Without successes, event n has draw n. Each success cancels the rest of its cell, which moves all later events
        # forward; only draws above the lowest threshold can be one.
        high = np.flatnonzero(numbers > min(thresholds))
        cancelled, successes = 0, []
        for draw, number in zip(high.tolist(), numbers[high].tolist(), strict=True):
            event = draw + cancelled
            if event >= len(events):
                break
            cell, ask = divmod(events[event], width)
            if number > thresholds[ask]:
                successes.append((cell, ask))
                while event + 1 < len(events) and events[event + 1] // width == cell:
                    event, cancelled = event + 1, cancelled + 1
        self.used = at + len(events) - cancelled
        return successes


def _ground(noise: dict[str, NDArray[np.float64]], draws: Draws) -> tuple[NDArray[np.uint8], Flags]:
    """The ground, and which of its cells are tunnels."""
    # How much each cell belongs to the meadow in the middle, from 0 to 1.
    start = 1 / (1 + np.exp(-(4 - FROM_CENTER + 2 * noise["start"])))
    water = noise["water"] + 0.15 * noise["water detail"] + 0.1
    water -= 2 * start
    mountain = (noise["mountain"] + 0.3 * noise["mountain detail"]) / 1.3
    mountain -= 4 * start + 0.3 * water
    meadow = start > 0.5
    mountains = ~meadow & (mountain > 0.15)
    caves = mountains & (noise["cave"] > 0.15) & (mountain > 0.3)
    tunnels = mountains & ~caves & ((noise["horizontal tunnel"] > 0.4) | (noise["vertical tunnel"] > 0.4))
    rock = mountains & ~caves & ~tunnels
    low = ~meadow & ~mountains
    beach = low & (water > 0.25) & (water <= 0.35) & (noise["sand"] > -0.2)
    lake = low & ~beach & (water > 0.3)
    land = low & ~beach & ~lake
    ground = np.full(CELLS, facts.GRASS, np.uint8)
    for where, material in (
        (caves | tunnels, facts.PATH),
        (rock, facts.STONE),
        (rock & (mountain > 0.3) & (noise["lava"] > 0.35), facts.LAVA),
        (beach, facts.SAND),
        (lake, facts.WATER),
    ):
        ground[where] = material
    asks = [
        (rock & (noise["coal"] > 0), 0.85),
        (rock & (noise["iron"] > 0.4), 0.75),
        (rock & (mountain > 0.18), 0.994),
        (land & (noise["tree"] > 0), 0.8),
    ]
    for cell, ask in draws.take(asks):
        ground[cell] = (facts.COAL, facts.IRON, facts.DIAMOND, facts.TREE)[ask]
    return ground, tunnels


def _creatures(ground: NDArray[np.uint8], tunnels: Flags, draws: Draws) -> list[tuple[int, int]]:
    """The first cows, zombies and skeletons."""
    grass = ground == facts.GRASS
    walkable = grass | (ground == facts.PATH) | (ground == facts.SAND)
    asks = [
        (grass & (FROM_CENTER > 3), 0.985),
        (walkable & (FROM_CENTER > 10), 0.993),
        (tunnels, 0.95),
    ]
    return [((facts.COW, facts.ZOMBIE, facts.SKELETON)[ask], cell) for cell, ask in draws.take(asks)]
