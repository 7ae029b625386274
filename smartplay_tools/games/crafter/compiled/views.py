"""The semantic and symbolic observations of a compiled world; the layouts are those of `observations`."""

from __future__ import annotations

from typing import Any

import numpy as np

from smartplay_tools.games.crafter.compiled.ground import thing_at
from smartplay_tools.games.crafter.compiled.jit import kernel
from smartplay_tools.games.crafter.facts import CARRIED, NAMES, PLANT, PLAYER, RIPE, VIEW
from smartplay_tools.games.crafter.observations import (
    AMOUNTS,
    BLOCK_OF,
    BLOCKS,
    CARRIED_FROM,
    CARRIED_ORDER,
    CELLS,
    CHANNELS,
    FACING_FROM,
    MOBS,
    PLANT_BLOCK,
    RIPE_BLOCK,
    SYMBOLIC_SIZE,
)
from smartplay_tools.games.crafter.world import COLUMN, CORNER, DIRECTIONS

_COLUMNS, _ROWS = VIEW
_DIRECTIONS = np.array(DIRECTIONS, np.int64)
_MOB_OF = np.array([MOBS.index(kind) if kind in MOBS else -1 for kind in range(len(NAMES))])
_FACING = CELLS + len(CARRIED)


@kernel
def number_of_direction(direction: int) -> int:
    """The number of a direction, in the order of `world.DIRECTIONS`."""
    for number in range(len(_DIRECTIONS)):
        if _DIRECTIONS[number] == direction:
            return number
    return -1


@kernel
def see_ids(world: Any, ids: Any) -> None:
    """Write the semantic observation into `ids`."""
    corner = world.at - CORNER
    for x in range(_COLUMNS):
        for y in range(_ROWS):
            ids[x * _ROWS + y] = world.surface[corner + x * COLUMN + y]
    for item in range(len(CARRIED)):
        ids[CELLS + item] = world.inventory[item]
    ids[_FACING] = number_of_direction(world.facing)
    ids[_FACING + 1] = world.sleeping


@kernel
def see_symbols(world: Any, things: Any, near: Any, light: Any, numbers: Any) -> None:
    """Write the symbolic observation into `numbers`."""
    for number in range(SYMBOLIC_SIZE):
        numbers[number] = 0
    corner = world.at - CORNER
    for y in range(_ROWS):
        for x in range(_COLUMNS):
            at, cell = corner + x * COLUMN + y, (y * _COLUMNS + x) * CHANNELS
            block, shown = BLOCK_OF[world.ground[at]], world.surface[at]
            if shown == PLANT:
                ripe = things[thing_at(world, things, near, at)].clock > RIPE
                block = RIPE_BLOCK if ripe else PLANT_BLOCK
            elif shown > PLAYER:
                numbers[cell + BLOCKS + _MOB_OF[shown]] = 1
            numbers[cell + block] = 1
    for number in range(len(CARRIED)):
        numbers[CARRIED_FROM + number] = AMOUNTS[world.inventory[CARRIED_ORDER[number]]]
    numbers[FACING_FROM + number_of_direction(world.facing)] = 1
    numbers[SYMBOLIC_SIZE - 2] = light[world.steps].daylight
    numbers[SYMBOLIC_SIZE - 1] = world.sleeping
