"""The choice of the place where an episode begins.

A place is first searched on the coarse map: dry, in no goal biome, with the nearest goal at the required distance. Then
a spot is searched on the ground there from which the player can walk away in most directions.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from smartplay_tools.games.minecraft.voxel.blocks import SOLID, Block
from smartplay_tools.games.minecraft.voxel.climate import SHORE, SPACING, Biome, biomes, climate
from smartplay_tools.games.minecraft.voxel.noise import hashed
from smartplay_tools.games.minecraft.voxel.world import BOTTOM, SIDE, World

NEAREST_GOAL, FARTHEST_GOAL = 310, 430
"""Bounds of the straight distance from a start to the nearest goal biome, in blocks."""

_SCALE = 2 * SPACING
"""Blocks between two points of the coarse map."""
_STARTS = 6
"""The map's points from the origin to the farthest start, along x and z; the map itself reaches a goal further.
As in the real game, worlds begin near the origin of their coordinates."""
_ROOM = 32
"""A player who can walk this far in three of the four directions is not enclosed."""
_TRIES = 6
"""The number of places that are tried in one world before another world is tried."""

_UNPLEASANT = (Biome.RIVER, Biome.FROZEN_RIVER, Biome.SWAMPLAND, Biome.EXTREME_HILLS)


def make_world(seed: int, goals: frozenset[int]) -> tuple[World, tuple[float, float, float]]:
    """The world of a seed, and a start in it. A world without a start for these goals is replaced by the next."""
    for attempt in itertools.count():
        this = (seed + attempt * 0x9E3779B9) % 2**32
        places = list(itertools.islice(_places(this, goals), _TRIES))
        if not places:
            continue
        world = World(this)
        for x, z in places:
            world.prepare(x, z)
            if (feet := _stand(world, x, z, goals)) is not None:
                return world, feet
    raise AssertionError("counting does not end")


def _places(seed: int, goals: frozenset[int]) -> Iterator[tuple[int, int]]:
    """Columns with the nearest goal in bounds, in random order."""
    reach = _STARTS + FARTHEST_GOAL // _SCALE + 1
    axis = np.arange(-reach, reach + 1) * _SCALE
    fields = climate(seed, axis[:, None], axis[None, :])
    biome = biomes(fields)
    good = (fields.land > SHORE) & ~_one_of(_UNPLEASANT)[biome]
    if goals:
        away = ndimage.distance_transform_edt(~_one_of(goals)[biome]) * _SCALE
        good &= (away >= NEAREST_GOAL) & (away <= FARTHEST_GOAL)
    inner = slice(reach - _STARTS, reach + _STARTS + 1)
    x, z = np.nonzero(good[inner, inner])
    order = np.argsort(hashed(seed, 301, x, z), kind="stable")
    for i, j in zip(x[order].tolist(), z[order].tolist(), strict=True):
        yield (i - _STARTS) * _SCALE, (j - _STARTS) * _SCALE


def _one_of(some: Iterable[int]) -> NDArray[np.bool_]:
    """By biome: whether it is one of these."""
    table = np.zeros(256, bool)
    table[list(some)] = True
    return table


def _stand(world: World, x: int, z: int, goals: frozenset[int]) -> tuple[float, float, float] | None:
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
