"""Guide: a path finder that knows the whole map, which shows whether the tasks can be done.

It plans on a grid of the ground - climbing, water and dense woods cost time - and then takes, action by action, the
heading that leads downhill on the remaining time. Where it got stuck it tries another heading.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import NDArray

from smartplay_tools.games.minecraft.voxel.climate import SEA_LEVEL, SPACING, Biome, biomes, climate, heights

if TYPE_CHECKING:
    from smartplay_tools.games.minecraft.voxel.engine import VoxelEngine

_REACH = 900
"""Blocks from the start to the borders of the map."""
_AHEAD = (8, 12, 16)
"""The blocks that an action is expected to walk along a heading."""
_HEADINGS = ((0, -1), (1, 0), (0, 1), (-1, 0))
"""x and z of the four actions: north, east, south, west."""
_STUCK = 3.0
"""A player that has moved less than this during an action has met an obstacle."""
_PATIENCE = 4
"""Actions for which a heading that met an obstacle is avoided."""

_WATER, _CLIMB, _WOODS = 4.0, 0.5, {Biome.JUNGLE: 1.6, Biome.ROOFED_FOREST: 1.6, Biome.ICE_SPIKES: 1.2}


class Guide:
    """Knows the way to the nearest goal for the player of one engine, after its reset."""

    def __init__(self, engine: VoxelEngine, goals: frozenset[int]) -> None:
        self._engine = engine
        x, _, z = engine.position
        self._west, self._north = int(x) // SPACING * SPACING - _REACH, int(z) // SPACING * SPACING - _REACH
        size = 2 * _REACH // SPACING + 1
        xs, zs = (corner + np.arange(size) * SPACING for corner in (self._west, self._north))
        self._time = _walking_time(engine.world.seed, xs, zs, goals)
        self._last: tuple[int, float, float] | None = None
        self._avoid = dict.fromkeys(range(len(_HEADINGS)), 0)

    def best_action(self) -> int:
        """The heading after which the least time is left."""
        x, _, z = self._engine.position
        self._avoid = {action: max(0, left - 1) for action, left in self._avoid.items()}
        if self._last is not None:
            action, last_x, last_z = self._last
            if abs(x - last_x) + abs(z - last_z) < _STUCK:
                self._avoid[action] = _PATIENCE
        options = [a for a, left in self._avoid.items() if not left] or list(self._avoid)
        best = min(options, key=lambda a: min(self._time_left(x, z, a, ahead) for ahead in _AHEAD))
        self._last = best, x, z
        return best

    def _time_left(self, x: float, z: float, action: int, ahead: int) -> float:
        dx, dz = _HEADINGS[action]
        last = len(self._time) - 1
        i = min(max(round((x + dx * ahead - self._west) / SPACING), 0), last)
        j = min(max(round((z + dz * ahead - self._north) / SPACING), 0), last)
        return float(self._time[i, j])


def _walking_time(
    seed: int, xs: NDArray[np.int64], zs: NDArray[np.int64], goals: frozenset[int]
) -> NDArray[np.float64]:
    """The time from every point of a grid to the nearest goal, in steps over free ground from point to point."""
    fields = climate(seed, xs[:, None], zs[None, :])
    biome, ground = biomes(fields), heights(seed, fields, xs[:, None], zs[None, :]).astype(float)
    effort = np.where(ground < SEA_LEVEL - 1, _WATER, 1.0)
    for kind, cost in _WOODS.items():
        effort[biome == kind] = cost
    level = np.maximum(ground, SEA_LEVEL - 2)
    number = np.arange(biome.size).reshape(biome.shape)
    rows, columns, costs = [], [], []
    for here, there in ((np.s_[:-1, :], np.s_[1:, :]), (np.s_[:, :-1], np.s_[:, 1:])):
        for a, b in ((here, there), (there, here)):
            # From a to b; searched backwards, from the goals.
            climb = np.maximum(level[b] - level[a] - 1, 0)
            rows.append(number[b].ravel())
            columns.append(number[a].ravel())
            costs.append(((effort[a] + effort[b]) / 2 + _CLIMB * climb).ravel())
    graph = scipy.sparse.csr_array(
        (np.concatenate(costs), (np.concatenate(rows), np.concatenate(columns))), shape=(biome.size, biome.size)
    )
    at_goal = np.flatnonzero(np.isin(biome, list(goals)))
    time: NDArray[np.float64] = scipy.sparse.csgraph.dijkstra(graph, indices=at_goal, min_only=True).reshape(
        biome.shape
    )
    return time
