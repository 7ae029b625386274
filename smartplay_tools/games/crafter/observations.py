"""Crafter's observations other than text: a picture, ids, or numbers; and the `info` of PyPI `crafter`.

- `image`: the package's own picture, 64 x 64 pixels of red, green and blue.
- `semantic`: ids (of `facts.NAMES`) of the 9 x 7 cells around the player, and its inventory.
- `symbolic`: 1,345 numbers in the order of Craftax-Classic's symbolic observation.

All three contain only what a picture shows: the cells around the player, its inventory, the direction it faces and
whether it sleeps.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from smartplay_tools.games.crafter.facts import CARRIED, ITEMS, MATERIALS, MOST, NAMES, VIEW, VITALS
from smartplay_tools.games.crafter.fast import CrafterEngine
from smartplay_tools.games.crafter.pictures import BODIES, LAYERS, USUAL, cells_seen, draw
from smartplay_tools.games.crafter.world import DIRECTIONS, cells_around

TEXT, IMAGE, SEMANTIC, SYMBOLIC = OBSERVATIONS = ("text", "image", "semantic", "symbolic")

CELLS = VIEW[0] * VIEW[1]

# --- Semantic --------------------------------------------------------------------------------------------------------

_CHOICES = [len(NAMES)] * CELLS + [MOST + 1] * len(CARRIED) + [len(DIRECTIONS), 2]
"""63 cells, column by column from the north-west; 16 amounts; the side that the player faces; whether it sleeps."""

# --- Symbolic: the numbers of Craftax-Classic ------------------------------------------------------------------------

_BLOCKS = (
    *("invalid", "nothing", "grass", "water", "stone", "tree", "wood", "path", "coal", "iron", "diamond"),
    *("table", "furnace", "sand", "lava", "plant", "plant-ripe"),
)
"""Craftax-Classic's kinds of block; invalid and wood do not occur, nothing is outside the map, plants are blocks."""
_BLOCK_OF = np.array([_BLOCKS.index(name) for name in NAMES[: len(MATERIALS) + 1]])
"""The block of each material; 0 is outside the map."""
MOBS = ("zombie", "cow", "skeleton", "arrow")
CHANNELS = len(_BLOCKS) + len(MOBS)
"""The numbers of a cell: which block, and which creature or arrow."""
AMOUNTS = (np.arange(MOST + 1, dtype=np.float16) / np.float16(10)).astype(np.float32)
"""Amounts as numbers: tenths, rounded to half precision as Craftax-Classic rounds them."""
CARRIED_ORDER = np.array(
    [CARRIED.index(name) for name in ("wood", "stone", "coal", "iron", "diamond", "sapling", *ITEMS[6:], *VITALS)]
)
"""The order of the amounts."""
SYMBOLIC_SIZE = CELLS * CHANNELS + len(CARRIED) + len(DIRECTIONS) + 2
"""The cells, row by row; the amounts; the side that the player faces; the light; whether the player sleeps."""


def space_of(observation: str) -> spaces.Space[Any]:
    """The space of an observation other than the text."""
    if observation == IMAGE:
        return spaces.Box(0, 255, (USUAL, USUAL, 3), np.uint8)
    if observation == SEMANTIC:
        return spaces.MultiDiscrete(np.array(_CHOICES), dtype=np.uint8)
    return spaces.Box(0, 1, (SYMBOLIC_SIZE,), np.float32)


def observe(engine: CrafterEngine, observation: str) -> NDArray[Any]:
    """What an engine shows, as one of the observations other than the text."""
    if observation == IMAGE:
        return draw(engine.scene())
    return _semantic(engine) if observation == SEMANTIC else _symbolic(engine)


def _semantic(engine: CrafterEngine) -> NDArray[np.uint8]:
    sight = engine.sight()
    cells = cells_around(sight.surface, sight.at)
    rest = [*sight.inventory.values(), DIRECTIONS.index(sight.facing), sight.sleeping]
    return np.concatenate([np.frombuffer(cells, np.uint8), np.array(rest, np.uint8)])


_MOB_LAYERS = [[LAYERS.index(body) for body in BODIES if body.startswith(mob)] for mob in MOBS]


def _symbolic(engine: CrafterEngine) -> NDArray[np.float32]:
    scene, sight = engine.scene(), engine.sight()
    materials, layers = cells_seen(scene)
    blocks = _BLOCK_OF[materials]
    for plant in ("plant", "plant-ripe"):
        blocks[layers == LAYERS.index(plant)] = _BLOCKS.index(plant)
    cells = np.zeros((*blocks.shape, CHANNELS), np.float32)
    cells[..., : len(_BLOCKS)] = blocks[..., None] == np.arange(len(_BLOCKS))
    for number, of_mob in enumerate(_MOB_LAYERS, start=len(_BLOCKS)):
        cells[..., number] = np.isin(layers, of_mob)
    carried = AMOUNTS[np.array(list(sight.inventory.values()))][CARRIED_ORDER]
    facing = [direction == sight.facing for direction in DIRECTIONS]
    rest = np.array([*facing, scene.daylight, sight.sleeping], np.float32)
    return np.concatenate([cells.ravel(), carried, rest])
