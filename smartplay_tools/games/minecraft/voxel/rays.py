"""The first block and the first animal that each of many rays hits.

A ray enters every cell through a plane between two layers of cells. The crossings of all rays with many planes are
computed at once, the cells behind them are looked up, and the nearest that is not air is the hit. This is exact and
needs no loop over cells. It is done in two stages, because most rays end near the eye: first with the planes near the
eye, then with those further away for the rays that are left.

Compiled by numba, a loop over the cells of each ray would save about a tenth of a step with its text. But importing
numba alone takes as long as that saves in 1,500 steps, so there is no such engine.
"""

from __future__ import annotations

import functools
import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from smartplay_tools.games.minecraft.voxel.blocks import Block
from smartplay_tools.games.minecraft.voxel.world import BOTTOM, HEIGHT, SIDE

Floats = NDArray[np.float32]

_PARALLEL = 1e-6
"""A ray that moves less than this along an axis crosses none of its planes within reach."""

_NEAR = 16.0
"""Blocks from the eye. A ray that has hit something nearer is left out of the second stage."""

_NEVER = 1e6
"""A distance behind every range: that of the planes of a parallel ray, and of what is not hit."""

_AIR = int(Block.AIR)


@dataclass(frozen=True)
class _Stage:
    """The planes from one distance on, as many as make every later one a block more distant than the stage's end."""

    near: float
    planes: Floats
    """The planes' coordinates, counted from the eye's cell, [plane, ray]: those of x, then of y, then of z."""
    spans: tuple[slice, ...]
    """By axis: its planes."""
    axis: NDArray[np.intp]
    """By plane: its axis."""


class Fan:
    """Rays from one eye, with what follows from their directions and ranges alone."""

    def __init__(self, directions: Floats, ranges: Floats) -> None:
        # Arrays have their rays last, so that NumPy's innermost loops are long.
        self.directions, self.ranges = directions, ranges
        slopes = directions.T.copy()
        moves = np.abs(slopes) > _PARALLEL
        along = np.where(moves, slopes, np.float32(1))
        self._rise = slopes[1].astype(np.float64)
        self._constants = np.stack([slopes, along, (along < 0).astype(np.float32)])
        self._stages: list[_Stage] = []
        first = [0, 0, 0]
        for near, far in itertools.pairwise((0.0, _NEAR, math.inf)):
            reach = (np.where(moves, np.abs(slopes), 0) * np.minimum(ranges, far)).max(axis=1)
            last = [int(r) + 2 if r else 0 for r in reach.tolist()]
            axis = np.repeat(np.arange(3), np.subtract(last, first))
            number = np.concatenate([np.arange(*span) for span in zip(first, last, strict=True)])[:, None]
            planes = np.where(along[axis] > 0, number + 1, -number).astype(np.float32)
            planes[~moves[axis]] = _NEVER
            borders = np.searchsorted(axis, range(4)).tolist()
            spans = tuple(slice(*span) for span in itertools.pairwise(borders))
            self._stages.append(_Stage(near, planes, spans, axis))
            first = last

    def hit_blocks(
        self, blocks: NDArray[np.uint8], eye: tuple[float, float, float], top: int = HEIGHT - 1
    ) -> tuple[NDArray[np.uint8], Floats]:
        """The block that each ray hits (air for none) and how far away (the range for none).

        `blocks` is the window of a `VoxelWorld`, which has only air above its layer `top`. Water and plants are hit
        like anything else.
        """
        corner = [math.floor(c) for c in eye]
        start = np.array([c - f for c, f in zip(eye, corner, strict=True)], np.float32)
        cell = np.array([corner[0], corner[1] - BOTTOM, corner[2]], np.int32)
        # A layer more, against rounding; and a ray that does not rise may come from above.
        sky = max(BOTTOM + top + 2 - eye[1], 1.0)
        hits, distances, axes = np.zeros(len(self.ranges), np.uint8), self.ranges.copy(), np.full(len(self.ranges), -1)
        for stage in self._stages:
            rays = np.flatnonzero((distances > stage.near) & (self._rise * stage.near < sky))
            if not len(rays):
                break
            block, distance, axis = self._first(stage, rays, blocks.reshape(-1), start, cell)
            # Of two planes that a ray crosses at once, through an edge, that of the first axis counts.
            nearest = distances[rays]
            nearer = (distance < nearest) | ((distance == nearest) & (axis < axes[rays]))
            rays = rays[nearer]
            hits[rays], distances[rays], axes[rays] = block[nearer], distance[nearer], axis[nearer]
        return hits, distances

    def _first(
        self,
        stage: _Stage,
        rays: NDArray[np.intp],
        flat: NDArray[np.uint8],
        start: Floats,
        cell: NDArray[np.int32],
    ) -> tuple[NDArray[np.uint8], Floats, NDArray[np.intp]]:
        """By ray, of the stage's planes that lead into a block, the nearest: the block, the distance, the axis.

        The eye is at `start` in that cell of the window.
        """
        planes, constants = stage.planes, self._constants
        if len(rays) < len(self.ranges):
            planes, constants = planes.take(rays, axis=1), constants.take(rays, axis=2)
        slopes, along, backward = constants
        reached = planes - start[stage.axis, None]
        for axis, span in enumerate(stage.spans):
            reached[span] /= along[axis]
        places = slopes[:, None] * reached
        places += start[:, None, None]
        np.floor(places, out=places)
        for axis, span in enumerate(stage.spans):
            np.subtract(planes[span], backward[axis], out=places[axis, span])
        cells = places.astype(np.int32)
        cells += cell[:, None, None]
        cells[::2] &= SIDE - 1
        x, y, z = cells
        free = y.view(np.uint32) >= HEIGHT
        x *= SIDE
        x += z
        x *= HEIGHT
        x += y
        blocks = flat.take(x, mode="clip")
        free |= blocks == _AIR
        # The sum is faster than an assignment where it is free.
        nearest = (reached + free * np.float32(_NEVER)).argmin(axis=0)
        each = np.arange(len(rays))
        distance = np.where(free[nearest, each], np.float32(np.inf), reached[nearest, each])
        return blocks[nearest, each], distance, stage.axis[nearest]


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
