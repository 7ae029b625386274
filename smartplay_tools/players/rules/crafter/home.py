"""A home in Crafter: a walled garden at the water, in which a player can live indefinitely.

Nothing can reach a player who is walled in on four sides, and nothing appears close to it. Water in the wall can be
drunk, and two or three plants ripen often enough to live on. Building is difficult: only the cell in front can be built
on, and a player who turns to a free cell walks into it. A free cell is therefore faced by walking towards it from two
cells away, so a room that is two cells wide in every direction can be closed from inside.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from smartplay_tools.players.rules.crafter.player import SOLID
from smartplay_tools.players.rules.crafter.sight import ANY, BIT, DIRECTIONS, WALKABLE, Cell
from smartplay_tools.players.rules.crafter.situation import Situation, direction

SHAPES = (
    (3, 2, "Move West"),
    (3, 2, "Move East"),
    (2, 3, "Move North"),
    (2, 3, "Move South"),
    (3, 3, "Move West"),
    (3, 3, "Move East"),
    (3, 3, "Move North"),
    (3, 3, "Move South"),
)
"""Widths and heights of rooms, and the side of the garden: the other cells of a row of three leave enough room to walk
towards it."""
LASTING = SOLID & ~(BIT["table"] | BIT["furnace"])
"""The materials that walls can be made of: arrows destroy tables and furnaces."""
SEARCH = 7
"""The distance from the player within which a site is searched."""


@dataclass(frozen=True)
class Home:
    """A room: its north-western cell, its size, and the side where plants grow."""

    left: int
    top: int
    width: int
    height: int
    side: str

    @cached_property
    def inside(self) -> frozenset[Cell]:
        """All cells of the room."""
        return frozenset(
            (x, y) for x in range(self.left, self.left + self.width) for y in range(self.top, self.top + self.height)
        )

    @cached_property
    def garden(self) -> tuple[Cell, ...]:
        """The cells for plants."""
        dx, dy = DIRECTIONS[self.side]
        return tuple(sorted((x, y) for x, y in self.inside if (x + dx, y + dy) not in self.inside))

    @cached_property
    def walls(self) -> tuple[Cell, ...]:
        """The cells around the room; its corners need no wall."""
        around = {(x + dx, y + dy) for x, y in self.inside for dx, dy in DIRECTIONS.values()}
        return tuple(sorted(around - self.inside))

    def is_beside_floor(self, wall: Cell) -> bool:
        """Whether a wall can be touched from a cell without a plant."""
        x, y = wall
        floor = self.inside - set(self.garden)
        return any((x + dx, y + dy) in floor for dx, dy in DIRECTIONS.values())


def find_site(now: Situation, *, dry: bool) -> Home | None:
    """The best place for a home among the known cells: few walls to build, and next to water unless `dry`."""
    x, y = now.map.at
    best: tuple[int, Home] | None = None
    for left in range(x - SEARCH, x + SEARCH):
        for top in range(y - SEARCH, y + SEARCH):
            if not is_walkable(now, (left, top)):
                continue
            for width, height, side in SHAPES:
                home = Home(left, top, width, height, side)
                cost = _cost(now, home, dry)
                if cost is not None and (best is None or cost < best[0]):
                    best = cost, home
    return best[1] if best else None


def has_water(now: Situation, home: Home) -> bool:
    """Whether there is water in the walls."""
    return any(now.kinds(wall) == BIT["water"] and home.is_beside_floor(wall) for wall in home.walls)


def _cost(now: Situation, home: Home, dry: bool) -> int | None:
    """The cost of a home in walls to build and steps to go; None if it cannot be built there."""
    if not all(is_walkable(now, cell) for cell in home.inside):
        return None
    if any(now.kinds(cell) != BIT["grass"] for cell in home.garden):
        return None
    to_build = sum(not is_solid(now, wall) for wall in home.walls)
    if now.lacks("stone", to_build) or any(
        now.kinds(wall) & BIT["lava"] and not is_solid(now, wall) for wall in home.walls
    ):
        return None
    thirst = 0 if has_water(now, home) else 40
    if thirst and not dry:
        return None
    way = min((now.reach[cell][0] for cell in home.inside if cell in now.reach), default=None)
    return None if way is None else 2 * to_build + way + thirst - 8 * len(home.garden)


def is_walkable(now: Situation, cell: Cell) -> bool:
    """Whether a cell is known to be free ground."""
    kinds = now.kinds(cell)
    return bool(kinds) and not kinds & ~WALKABLE


def is_solid(now: Situation, cell: Cell) -> bool:
    """Whether, as far as is known, nothing can walk through a cell."""
    kinds = now.kinds(cell)
    return bool(kinds & ANY) and not kinds & ~LASTING


def dwell(now: Situation, home: Home, clock: int) -> str | None:
    """Go home, wall it in, and live there."""
    if now.map.at not in home.inside:
        reachable = [cell for cell in home.inside if cell in now.reach]
        return now.walk(min(reachable, key=lambda cell: now.reach[cell][0])) if reachable else None
    open_walls = [wall for wall in home.walls if not is_solid(now, wall)]
    if open_walls and now.has("stone"):
        return _build(now, home, open_walls)
    return _live(now, home, clock)


def _build(now: Situation, home: Home, open_walls: list[Cell]) -> str | None:
    ways = [way for wall in open_walls if (way := _approach(now, home, wall))]
    if not ways:
        return None
    _, move, _ = min(ways)
    if move:
        return move
    if now.frame.faced in ("grass", "sand", "path"):
        return "Place Stone"
    return "Do" if now.frame.faced in ("cow", "zombie", "skeleton") else "Noop"


def _approach(now: Situation, home: Home, target: Cell) -> tuple[int, str, Cell] | None:
    """How to face a cell that may be free, from inside: (cost, next move, target); no move once it is faced."""
    best: tuple[int, str, Cell] | None = None
    for move, (dx, dy) in DIRECTIONS.items():
        beside = target[0] - dx, target[1] - dy
        before = beside[0] - dx, beside[1] - dy
        if beside not in home.inside or beside not in now.reach:
            continue
        if now.map.at == beside and (now.map.facing == move or is_solid(now, target)):
            return 0, "" if now.map.facing == move else move, target
        if before in home.inside and before in now.reach:
            step = move if now.map.at == before else now.walk(before)
            way = now.reach[before][0] + 1, step, target
            best = way if best is None or way < best else best
    return best


def _live(now: Situation, home: Home, clock: int) -> str:
    """Live inside closed walls: drink, eat, sleep, and tend the garden."""
    water = [wall for wall in home.walls if now.kinds(wall) == BIT["water"] and home.is_beside_floor(wall)]
    plants = [cell for cell in home.garden if now.kinds(cell) == BIT["plant"]]
    beds = [cell for cell in home.garden if cell not in plants]
    if now.frame.distance("cow") == 1:
        dx, dy = now.frame.cells("cow")[0]
        turn = direction((0, 0), (dx, dy))
        return "Do" if now.frame.faced == "cow" else turn
    if water and now.lacks("drink", 5 if now.has("energy", 3) else 3):
        return now.go(water) or "Noop"
    if now.lacks("energy", 2):
        return "Sleep"
    ways = [way for bed in beds if (way := _approach(now, home, bed))]
    if ways:
        _, move, _ = min(ways)
        return move or ("Place Plant" if now.has("sapling") else "Do")
    # In sleep, hunger and thirst grow half as fast, and health recovers twice as fast.
    if now.lacks("energy", 8):
        return "Sleep"
    if now.lacks("food", 6) and plants:
        # Whether a plant is ripe cannot be seen; trying does no harm.
        return now.go([plants[clock // 30 % len(plants)]]) or "Noop"
    if water and now.lacks("drink", 9):
        return now.go(water) or "Noop"
    return "Noop"
