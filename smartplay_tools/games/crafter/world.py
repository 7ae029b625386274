"""The world: the material of each cell, the things on the map, and the chunks in which things are counted.

A cell is named by one number, `(x + 4) * 128 + y + 4`: the map has a margin of four cells with the id 0, so that the
view never leaves the array. Two maps are kept. `ground` has the material of each cell; `surface` has what is visible
there, the thing if there is one and otherwise the material. The surface alone shows whether a cell is free, what the
player faces, and what the text has to mention.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from smartplay_tools.games.crafter.facts import (
    AREA,
    ARROW,
    CHUNK,
    CHUNKS,
    GRASS,
    HEALTH,
    NAMES,
    PATH,
    PLAYER,
    UPDATE_DISTANCE,
    VIEW,
)
from smartplay_tools.games.crafter.stream import Stream
from smartplay_tools.games.crafter.worldgen import CENTER, generate

MARGIN = 4
COLUMN = 128
"""The difference between neighbouring columns. A power of two, and more than twice the side of the map, so that the
difference of two cells determines their distance and direction."""
WEST, EAST, NORTH, SOUTH = DIRECTIONS = (-COLUMN, COLUMN, -1, 1)

RELIST_STEPS = 8
NEAR = UPDATE_DISTANCE + RELIST_STEPS + 1
"""A thing at this distance does not move and cannot get closer than `UPDATE_DISTANCE` within `RELIST_STEPS` steps."""


def place(x: int, y: int) -> int:
    """The number of a cell."""
    return (x + MARGIN) * COLUMN + y + MARGIN


def position(at: int) -> tuple[int, int]:
    """The coordinates of a cell."""
    return at // COLUMN - MARGIN, at % COLUMN - MARGIN


CORNER = VIEW[0] // 2 * COLUMN + VIEW[1] // 2
"""The difference between a player's place and the north-west corner of its view."""


def cells_around(cells: bytes | bytearray, at: int) -> bytes:
    """The cells that a player at a place sees, column by column."""
    corner, (columns, rows) = at - CORNER, VIEW
    return b"".join([cells[start : start + rows] for start in range(corner, corner + columns * COLUMN, COLUMN)])


IN_VIEW = {column * COLUMN + row - CORNER: (column, row) for column in range(VIEW[0]) for row in range(VIEW[1])}
"""Column and row in the view by the difference of a place and the player's; a place that it does not see has none."""


def _difference_tables() -> tuple[bytes, list[int], list[int]]:
    """Distance and directions by the difference of two places; negative differences count from the tables' ends."""
    size = 2 * AREA * COLUMN
    distance, along_longer, along_shorter = bytearray(size), [0] * size, [0] * size
    for dx in range(1 - AREA, AREA):
        for dy in range(1 - AREA, AREA):
            difference = dx * COLUMN + dy
            distance[difference] = abs(dx) + abs(dy)
            across, down = COLUMN * ((dx > 0) - (dx < 0)), (dy > 0) - (dy < 0)
            pair = (across, down) if abs(dx) > abs(dy) else (down, across)
            along_longer[difference], along_shorter[difference] = pair
    return bytes(distance), along_longer, along_shorter


DISTANCE, TOWARD_LONGER, TOWARD_SHORTER = _difference_tables()
"""By (target - here): the distance in steps, and the step along the axis with the longer (or shorter) distance."""

CHUNK_OF = bytes(
    (x // CHUNK) * CHUNKS + y // CHUNK if 0 <= x < AREA and 0 <= y < AREA else 0
    for x, y in map(position, range((AREA + 2 * MARGIN) * COLUMN))
)
"""The chunk of each place."""


class Thing:
    """A creature, an arrow or a plant.

    Attributes:
        kind: its id in `facts.NAMES`.
        at: the place where it stands.
        health: a thing without health is removed when its turn comes.
        clock: steps until a zombie can strike or a skeleton can shoot again; steps that a plant has grown.
        heading: the direction in which an arrow flies.
        removed: whether it has been taken off the map. It may still have its turn in that step.
    """

    __slots__ = ("at", "clock", "heading", "health", "kind", "removed")

    def __init__(self, kind: int, at: int, heading: int = 0) -> None:
        self.kind = kind
        self.at = at
        self.health = HEALTH[kind]
        self.clock = 0
        self.heading = heading
        self.removed = False


class Chunk:
    """The facts about a part of the map that `balance` uses; `things` is a dict to keep the order of arrival."""

    __slots__ = ("counts", "things")

    def __init__(self) -> None:
        self.things: dict[Thing, None] = {}
        self.counts = [0] * len(NAMES)


class World:
    """The state of the map. The player appears on it as an id on the surface; its state is in `player.CrafterPlayer`.

    Attributes:
        ground, surface: the two maps that the module describes.
        stream: the random stream.
        things: all things, in the order in which they appeared.
        near: those that may be close enough to move, in the same order; rebuilt every few steps.
        chunks: the chunks that something has ever been in, in the order of their first visit.
        grass, paths: the number of such cells in each chunk.
    """

    __slots__ = ("chunks", "grass", "ground", "near", "paths", "stream", "surface", "things")

    def __init__(self, seed: int) -> None:
        self.stream = Stream(seed)
        terrain = generate(self.stream)
        square = terrain.ground.reshape(AREA, AREA)
        padded = np.zeros((AREA + 2 * MARGIN, COLUMN), np.uint8)
        padded[MARGIN : MARGIN + AREA, MARGIN : MARGIN + AREA] = square
        self.ground = bytearray(padded.tobytes())
        self.surface = bytearray(self.ground)
        self.grass, self.paths = (_count_by_chunk(square == material) for material in (GRASS, PATH))
        self.things: list[Thing] = []
        self.near: list[Thing] = []
        self.chunks: dict[int, Chunk] = {}
        start = place(CENTER, CENTER)
        self.surface[start] = PLAYER
        self.visit(start)
        for kind, cell in terrain.creatures:
            self.add(Thing(kind, place(*divmod(cell, AREA))))

    def list_near(self, at: int) -> None:
        """List the things that may have a turn in the next steps of a player who stands at a place."""
        self.near = [thing for thing in self.things if DISTANCE[thing.at - at] < NEAR]

    def thing_at(self, at: int) -> Thing:
        """The thing at a place near the player at which the surface shows one."""
        return next(thing for thing in self.near if thing.at == at)

    def visit(self, at: int) -> Chunk:
        """The chunk of a place, which is created when something enters it."""
        key = CHUNK_OF[at]
        if key not in self.chunks:
            self.chunks[key] = Chunk()
        return self.chunks[key]

    def add(self, thing: Thing) -> None:
        """Put a thing on the map."""
        self.surface[thing.at] = thing.kind
        self.things.append(thing)
        self.near.append(thing)
        chunk = self.visit(thing.at)
        chunk.things[thing] = None
        chunk.counts[thing.kind] += 1

    def remove(self, thing: Thing) -> None:
        """Take a thing off the map."""
        if thing.removed:
            return
        thing.removed = True
        self.surface[thing.at] = self.ground[thing.at]
        self.things.remove(thing)
        if thing in self.near:
            self.near.remove(thing)
        chunk = self.chunks[CHUNK_OF[thing.at]]
        del chunk.things[thing]
        chunk.counts[thing.kind] -= 1

    def move(self, thing: Thing, target: int) -> None:
        """Move a thing to a free cell; does nothing for a removed one."""
        if thing.removed:
            return
        here, kind = thing.at, thing.kind
        self.surface[here] = self.ground[here]
        self.surface[target] = kind
        thing.at = target
        if CHUNK_OF[here] != CHUNK_OF[target]:
            left, entered = self.chunks[CHUNK_OF[here]], self.visit(target)
            del left.things[thing]
            left.counts[kind] -= 1
            entered.things[thing] = None
            entered.counts[kind] += 1

    def set_ground(self, at: int, material: int) -> None:
        """Change the material of a cell."""
        old = self.ground[at]
        self.ground[at] = material
        if self.surface[at] < PLAYER:
            self.surface[at] = material
        for counted, by_chunk in ((GRASS, self.grass), (PATH, self.paths)):
            by_chunk[CHUNK_OF[at]] += (material == counted) - (old == counted)

    def state(self) -> Any:
        """Everything except the stream, as JSON; the chunks list their things by number."""
        number = {thing: n for n, thing in enumerate(self.things)}
        return [
            without_margin(self.ground).hex(),
            [
                [t.kind, *position(t.at), t.health, t.clock, DIRECTIONS.index(t.heading) if t.kind == ARROW else 0]
                for t in self.things
            ],
            [[key, [number[thing] for thing in chunk.things]] for key, chunk in self.chunks.items()],
        ]


def _count_by_chunk(cells: np.ndarray[Any, np.dtype[np.bool_]]) -> list[int]:
    cuts = np.arange(0, AREA, CHUNK)
    counts: list[int] = np.add.reduceat(np.add.reduceat(cells.astype(np.int64), cuts, 0), cuts, 1).ravel().tolist()
    return counts


def without_margin(cells: bytearray) -> bytes:
    """The cells of the map alone, column by column."""
    inside = slice(MARGIN, MARGIN + AREA)
    return np.frombuffer(cells, np.uint8).reshape(-1, COLUMN)[inside, inside].tobytes()
