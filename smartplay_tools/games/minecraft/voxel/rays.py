"""The first block and the first animal that each of many rays hits.

A ray enters every cell through a plane between two layers of cells. The crossings of all rays with all planes in reach
are computed at once, the cells behind them are looked up, and the nearest that is not air is the hit. This is exact and
needs no loop over cells.
"""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.typing import NDArray

from smartplay_tools.games.minecraft.voxel.blocks import Block
from smartplay_tools.games.minecraft.voxel.world import BOTTOM, HEIGHT, SIDE

Floats = NDArray[np.float32]

_PARALLEL = 1e-6
"""A ray that moves less than this along an axis crosses none of its planes within reach."""

_NEVER = 1e6
"""A distance behind every range: that of the planes of a parallel ray, and of what is not hit."""

_AIR = int(Block.AIR)


class Fan:
    """Rays from one eye, with what follows from their directions and ranges alone."""

    def __init__(self, directions: Floats, ranges: Floats) -> None:
        # Arrays have their rays last, so that NumPy's innermost loops are long.
        self.directions, self.ranges = directions, ranges
        self._slopes = directions.T.copy()
        moves = np.abs(self._slopes) > _PARALLEL
        self._along = np.where(moves, self._slopes, np.float32(1))
        self._backward = (self._along < 0).astype(np.float32)
        reach = (np.where(moves, np.abs(self._slopes), 0) * ranges).max(axis=1)
        counts = [int(r) + 2 if r else 0 for r in reach.tolist()]
        self._axis = np.repeat(np.arange(3), counts)
        """By plane: its axis; first are those of x, then those of y and z."""
        number = np.concatenate([np.arange(count) for count in counts])[:, None]
        self._planes = np.where(self._along[self._axis] > 0, number + 1, -number).astype(np.float32)
        """The planes' coordinates, counted from the eye's cell, by plane and ray."""
        self._planes[~moves[self._axis]] = _NEVER

    def hit_blocks(
        self, blocks: NDArray[np.uint8], eye: tuple[float, float, float]
    ) -> tuple[NDArray[np.uint8], Floats]:
        """The block that each ray hits (air for none) and how far away (the range for none).

        `blocks` is the window of a `VoxelWorld`. Water and plants are hit like anything else.
        """
        corner = [math.floor(c) for c in eye]
        start = np.array([c - f for c, f in zip(eye, corner, strict=True)], np.float32)
        reached = (self._planes - start[self._axis, None]) / self._along[self._axis]
        places = np.floor(self._slopes[:, None] * reached + start[:, None, None])
        for axis in range(3):
            own = self._axis == axis
            places[axis, own] = self._planes[own] - self._backward[axis]
        x, y, z = (
            places.astype(np.int32) + np.array([corner[0], corner[1] - BOTTOM, corner[2]], np.int32)[:, None, None]
        )
        behind = blocks.reshape(-1).take(((x & (SIDE - 1)) * SIDE + (z & (SIDE - 1))) * HEIGHT + y, mode="clip")
        is_free = (y.view(np.uint32) >= HEIGHT) | (behind == _AIR)
        # Of two planes that a ray crosses at once, through an edge, that of the first axis counts.
        nearest, each = (reached + is_free * np.float32(_NEVER)).argmin(axis=0), np.arange(len(self.ranges))
        distances = np.where(is_free[nearest, each], np.float32(np.inf), reached[nearest, each])
        is_hit = distances < self.ranges
        return np.where(is_hit, behind[nearest, each], np.uint8(_AIR)), np.where(is_hit, distances, self.ranges)


def hit_boxes(
    low: Floats, high: Floats, eye: tuple[float, float, float], directions: Floats, ranges: Floats
) -> tuple[NDArray[np.intp], Floats]:
    """The nearest box, given by two corners, that each ray enters within its range (-1 for none) and how far away."""
    if not len(low):
        return np.full(len(directions), -1), ranges.copy()
    # One axis at a time, because numpy is slow at reducing over an axis of length three.
    with np.errstate(divide="ignore", invalid="ignore"):
        spans = [
            ((low[:, axis] - at) / directions[:, axis, None], (high[:, axis] - at) / directions[:, axis, None])
            for axis, at in enumerate(np.array(eye, np.float32))
        ]
    # A ray in the plane of a face is 0/0: fmax and fmin leave that axis out.
    enters = functools.reduce(np.fmax, (np.fmin(a, b) for a, b in spans))
    leaves = functools.reduce(np.fmin, (np.fmax(a, b) for a, b in spans))
    entered = np.where((enters <= leaves) & (enters >= 0), enters, np.inf)
    nearest = entered.argmin(axis=1)
    distances = entered[np.arange(len(directions)), nearest]
    hit = distances < ranges
    return np.where(hit, nearest, -1), np.where(hit, distances, ranges)
