"""Crafter's rules as tables: materials, things, items, and what each action needs and yields.

The numbers are those of `data.yaml` in PyPI `crafter` 1.8.3; a test compares the two. They are repeated here so that
the default engine runs without importing that package.
"""

from __future__ import annotations

from typing import NamedTuple

AREA = 64
"""The world is a square of this many cells; x grows to the east, y to the south."""
CHUNK = 12
"""Creatures are balanced within chunks of this size, in cells."""
CHUNKS = -(-AREA // CHUNK)
"""Chunks along a side; the last one is cut off by the border."""
VIEW = (9, 7)
"""The cells that a player sees: columns and rows, itself in the middle."""
UPDATE_DISTANCE = 18
"""Things at this distance (steps) from the player or farther stand still."""
LENGTH = 10_000
"""The step of the engine at which an episode is truncated."""
NIGHT_PIXELS = 63 * 49
"""A picture of Crafter's usual size, 64, shows the world in 63 x 49 pixels, and at night each of them costs one draw
from the world's random stream. The picture is therefore part of the rules, even if it is not used."""

MATERIALS = (
    "water",
    "grass",
    "stone",
    "path",
    "sand",
    "tree",
    "lava",
    "coal",
    "iron",
    "diamond",
    "table",
    "furnace",
)
THINGS = ("player", "cow", "zombie", "skeleton", "arrow", "plant")
NAMES = ("nothing", *MATERIALS, *THINGS)
"""The materials and things that a cell can show, by id; 0 is outside the map."""
WATER, GRASS, STONE, PATH, SAND, TREE, LAVA, COAL, IRON, DIAMOND, TABLE, FURNACE = range(1, 13)
PLAYER, COW, ZOMBIE, SKELETON, ARROW, PLANT = range(13, 19)
HEALTH = {COW: 3, ZOMBIE: 5, SKELETON: 3, ARROW: 0, PLANT: 1}
"""The initial health of a thing."""

WALKABLE = (GRASS, PATH, SAND)
WALKABLE_FOR_PLAYER = (*WALKABLE, LAVA)
WALKABLE_FOR_ARROW = (*WALKABLE, WATER, LAVA)


class Collecting(NamedTuple):
    """Collecting a material: what it requires, yields and leaves behind."""

    tool: str | None
    item: str
    leaves: int
    probability: float = 1.0


class Placing(NamedTuple):
    """Placing a material or a plant: what it uses up, and on which materials it is possible."""

    uses: tuple[tuple[str, int], ...]
    where: tuple[int, ...]
    what: int


class Making(NamedTuple):
    """Making a tool: what it uses up, and what has to be in the 3 x 3 cells around the player."""

    uses: tuple[tuple[str, int], ...]
    nearby: tuple[int, ...]


COLLECT = {
    TREE: Collecting(None, "wood", GRASS),
    STONE: Collecting("wood_pickaxe", "stone", PATH),
    COAL: Collecting("wood_pickaxe", "coal", PATH),
    IRON: Collecting("stone_pickaxe", "iron", PATH),
    DIAMOND: Collecting("iron_pickaxe", "diamond", PATH),
    WATER: Collecting(None, "drink", WATER),
    GRASS: Collecting(None, "sapling", GRASS, probability=0.1),
}

PLACE = {
    "stone": Placing((("stone", 1),), (GRASS, SAND, PATH, WATER, LAVA), STONE),
    "table": Placing((("wood", 2),), (GRASS, SAND, PATH), TABLE),
    "furnace": Placing((("stone", 4),), (GRASS, SAND, PATH), FURNACE),
    "plant": Placing((("sapling", 1),), (GRASS,), PLANT),
}

MAKE = {
    "wood_pickaxe": Making((("wood", 1),), (TABLE,)),
    "stone_pickaxe": Making((("wood", 1), ("stone", 1)), (TABLE,)),
    "iron_pickaxe": Making((("wood", 1), ("coal", 1), ("iron", 1)), (TABLE, FURNACE)),
    "wood_sword": Making((("wood", 1),), (TABLE,)),
    "stone_sword": Making((("wood", 1), ("stone", 1)), (TABLE,)),
    "iron_sword": Making((("wood", 1), ("coal", 1), ("iron", 1)), (TABLE, FURNACE)),
}

VITALS = ("health", "food", "drink", "energy")
ITEMS = ("sapling", "wood", "stone", "coal", "iron", "diamond", *MAKE)
CARRIED = (*VITALS, *ITEMS)
MOST = 9
"""The largest amount of any vital or item; vitals start at it, items at 0."""

ACTIONS = (
    *("noop", "move_left", "move_right", "move_up", "move_down", "do", "sleep"),
    *(f"place_{name}" for name in PLACE),
    *(f"make_{name}" for name in MAKE),
)
NOOP, SLEEP = ACTIONS.index("noop"), ACTIONS.index("sleep")

DAMAGE = (("iron_sword", 5), ("stone_sword", 3), ("wood_sword", 2))
"""The damage of a blow by the best sword; 1 without a sword."""

RIPE = 300
"""A plant that has grown for more steps than this can be eaten."""
