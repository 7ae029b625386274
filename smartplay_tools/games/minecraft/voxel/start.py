"""The choice of the place where an episode begins.

A place is first searched on the coarse map: dry, in no goal biome, with the nearest goal at the required distance. Then
a spot is searched on the ground there from which the player can walk away in most directions.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from smartplay_tools.games.minecraft.voxel.blocks import SOLID, Block
from smartplay_tools.games.minecraft.voxel.climate import SHORE, SPACING, Biome, biomes, climate
from smartplay_tools.games.minecraft.voxel.noise import hashed
from smartplay_tools.games.minecraft.voxel.world import BOTTOM, SIDE, VoxelWorld

NEAREST_GOAL, FARTHEST_GOAL = 310, 430
"""Bounds of the straight distance from a start to the nearest goal biome, in blocks."""

_SCALE = 2 * SPACING
"""Blocks between two points of the coarse map."""
_STARTS = 6
"""The map's points from the origin to the farthest start, along x and z; the map itself reaches a goal further.
As in the real game, worlds begin near the origin of their coordinates."""
_REACH = _STARTS + FARTHEST_GOAL // _SCALE + 1
"""The map's points from the origin to its edge."""
_INNER = slice(_REACH - _STARTS, _REACH + _STARTS + 1)
"""The points of an axis where a start can be."""
_SQUARES = (np.arange(2 * _REACH + 1)[_INNER, None] - np.arange(2 * _REACH + 1)) ** 2
"""By point of an axis where a start can be, and by point of the whole axis: the squared distance."""
_NOWHERE = 1 << 30
"""The squared distance to a goal that a row of the map does not have."""
_ROOM = 32
"""A player who can walk this far in three of the four directions is not enclosed."""
_TRIES = 6
"""The number of places that are tried in one world before another world is tried."""

_UNPLEASANT = (Biome.RIVER, Biome.FROZEN_RIVER, Biome.SWAMPLAND, Biome.EXTREME_HILLS)


def make_world(seed: int, goals: frozenset[int]) -> tuple[VoxelWorld, tuple[float, float, float]]:
    """The world of a seed, and a start in it. A world without a start for these goals is replaced by the next."""
    for attempt in itertools.count():
        this = (seed + attempt * 0x9E3779B9) % 2**32
        places = list(itertools.islice(_places(this, goals), _TRIES))
        if not places:
            continue
        world = VoxelWorld(this)
        for x, z in places:
            world.prepare(x, z)
            if (feet := _stand(world, x, z, goals)) is not None:
                return world, feet
    raise AssertionError("counting does not end")


def _places(seed: int, goals: frozenset[int]) -> Iterator[tuple[int, int]]:
    """Columns with the nearest goal in bounds, in random order."""
    axis = np.arange(-_REACH, _REACH + 1) * _SCALE
    fields = climate(seed, axis[:, None], axis[None, :])
    biome = biomes(fields)
    good = ((fields.land > SHORE) & ~_one_of(_UNPLEASANT)[biome])[_INNER, _INNER]
    if goals:
        away = goal_distances(_one_of(goals)[biome])
        good &= (away >= NEAREST_GOAL) & (away <= FARTHEST_GOAL)
    x, z = np.nonzero(good)
    order = np.argsort(hashed(seed, 301, x, z), kind="stable")
    for i, j in zip(x[order].tolist(), z[order].tolist(), strict=True):
        yield (i - _STARTS) * _SCALE, (j - _STARTS) * _SCALE


def goal_distances(goal: NDArray[np.bool_]) -> NDArray[np.float64]:
    """The distance in blocks from each possible start to the nearest goal of a map; without a goal, far off the map.

    A squared distance is the sum of one along x and one along z: first the nearest goal in each row of the map, then
    the nearest of all rows.
    """
    across = np.where(goal[:, None, :], _SQUARES, _NOWHERE).min(axis=2)
    distances: NDArray[np.float64] = np.sqrt((_SQUARES[:, :, None] + across).min(axis=1)) * _SCALE
    return distances


def _one_of(some: Iterable[int]) -> NDArray[np.bool_]:
    """By biome: whether it is one of these."""
    table = np.zeros(256, bool)
    table[list(some)] = True
    return table


def _stand(world: VoxelWorld, x: int, z: int, goals: frozenset[int]) -> tuple[float, float, float] | None:
    """The position of the feet at a column, or None if the player cannot walk away from there."""
    i, j = ((np.arange(c - _ROOM, c + _ROOM + 1) & (SIDE - 1)) for c in (x, z))
    i, j = i[:, None], j[None, :]
    ground = world.ground[i, j].astype(int)
    above = world.blocks[i, j, ground + 1], world.blocks[i, j, ground + 2]
    solid = np.frombuffer(SOLID, bool)
    enterable = ~solid[above[0]] & ~solid[above[1]]
    middle = (_ROOM, _ROOM)
    if not enterable[middle] or above[0][middle] == Block.WATER or world.biome_at(x, z) in goals:
        return None
    reached = _walkable(ground, enterable)
    sides = reached[0].any(), reached[-1].any(), reached[:, 0].any(), reached[:, -1].any()
    if sum(map(bool, sides)) < 3:
        return None
    return x + 0.5, float(ground[middle] + BOTTOM + 1), z + 0.5


def _walkable(ground: NDArray[np.int_], enterable: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which columns can be reached from the middle one, climbing one block at a time."""
    steps = []
    for axis, ahead in itertools.product((0, 1), (True, False)):
        here: list[slice] = [slice(None), slice(None)]
        there = list(here)
        here[axis], there[axis] = (slice(None, -1), slice(1, None)) if ahead else (slice(1, None), slice(None, -1))
        low, high = tuple(here), tuple(there)
        steps.append((low, high, enterable[high] & (ground[high] - ground[low] <= 1)))
    reached = np.zeros(ground.shape, bool)
    reached[ground.shape[0] // 2, ground.shape[1] // 2] = True
    count = 0
    while count != (count := int(reached.sum())):
        for low, high, possible in steps:
            reached[high] |= reached[low] & possible
    return reached
