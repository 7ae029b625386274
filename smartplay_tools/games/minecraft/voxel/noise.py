"""Hashes and smooth fields over the plane, whose values do not depend on the rectangle that is computed.

Only integer arithmetic, +, -, * and / are used, which give the same bits on every machine. Places are integer
coordinates, given as a column of x and a row of z; results are [x, z].
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Axis = NDArray[np.int64]
Field = NDArray[np.float32]


def hashed(seed: int, salt: int, x: Axis, z: Axis) -> NDArray[np.uint32]:
    """32 random-looking bits for every place; `x` and `z` broadcast."""
    return _scrambled(x, z, np.uint32(_mixed(seed, salt)))


def _mixed(seed: int, salt: int) -> int:
    return (seed * 2246822519 + salt * 3266489917) & 0xFFFFFFFF


def _scrambled(x: Axis, z: Axis, mixed: Any) -> NDArray[np.uint32]:
    h: NDArray[np.uint32] = x.astype(np.uint32) * np.uint32(374761393) + z.astype(np.uint32) * np.uint32(668265263)
    h += mixed
    for factor, shift in ((1274126177, 15), (2869860233, 13)):
        h ^= h >> np.uint32(shift)
        h *= np.uint32(factor)
    h ^= h >> np.uint32(16)
    return h


def unit(bits: NDArray[np.uint32]) -> Field:
    """Hash bits as numbers in [0, 1); 24 of them, so that the conversion is exact."""
    return (bits >> np.uint32(8)).astype(np.float32) * np.float32(1 / (1 << 24))


@dataclass(frozen=True)
class Fractal:
    """A sum of smooth fields, each twice as fine and half as strong as the one before."""

    salt: int
    scale: int
    """Blocks between the random values of the first field; a power of two times any number of blocks."""
    octaves: int
    east: int = 0
    south: int = 0
    """The place that is asked for lies that many blocks before the place of the result."""


class Noise:
    """Several fractals in [-1, 1], which are computed together: for a small rectangle, the calls of NumPy are the cost.

    A smooth field is made of random values `scale` blocks apart, joined by quintic curves. All octaves of all fractals
    are the layers, along the first axis of the arrays.
    """

    def __init__(self, *fractals: Fractal) -> None:
        layers = [(fractal, octave) for fractal in fractals for octave in range(fractal.octaves)]
        self._salts = [fractal.salt * 16 + octave for fractal, octave in layers]
        self._scale = np.array([max(fractal.scale >> octave, 1) for fractal, octave in layers])[:, None]
        self._east = np.array([fractal.east for fractal, _ in layers])[:, None]
        self._south = np.array([fractal.south for fractal, _ in layers])[:, None]
        self._strength = np.array([0.5**octave for _, octave in layers], np.float32)[:, None, None]
        self._total = np.array([1 / (2 - 0.5 ** (f.octaves - 1)) for f in fractals], np.float32)[:, None, None]
        self._first = np.cumsum([0, *(fractal.octaves for fractal in fractals[:-1])])
        octaves = np.array([fractal.octaves for fractal in fractals])
        self._octaves = max(octaves)
        self._deep = [np.flatnonzero(octaves > octave) for octave in range(self._octaves)]

    def __call__(self, seed: int, x: Axis, z: Axis) -> Field:
        """The fractals at the given places, [fractal, x, z]."""
        west, i, x_weight = self._cells(x.ravel() + self._east)
        north, j, z_weight = self._cells(z.ravel() + self._south)
        salts = np.array([_mixed(seed, salt) for salt in self._salts], np.uint32)[:, None, None]
        corners = unit(_scrambled(west[:, :, None], north[:, None, :], salts)) * np.float32(2) - np.float32(1)
        # Rows first, because the gathered array, (places in x) x (corners in z), is then small.
        layer = np.arange(len(self._salts))[:, None]
        rows = corners[layer, i + 1]
        low = corners[layer, i]
        rows -= low
        rows *= x_weight[:, :, None]
        rows += low
        across = rows.shape[2]
        at = np.arange(0, rows.size, across).reshape(*rows.shape[:2], 1) + j[:, None, :]
        low = rows.take(at)
        at += 1
        fields = rows.take(at)
        fields -= low
        fields *= z_weight[:, None, :]
        fields += low
        fields *= self._strength
        # Octave by octave: NumPy's own sums leave the order of their terms open, and with it the last bit.
        totals = fields[self._first]
        for octave in range(1, self._octaves):
            deep = self._deep[octave]
            totals[deep] += fields[self._first[deep] + octave]
        totals *= self._total
        return totals

    def _cells(self, places: Axis) -> tuple[Axis, Axis, Field]:
        """By layer: the lattice's coordinates, and for every place its cell of the lattice and its weight there."""
        cell, rest = np.divmod(places, self._scale)
        first = cell[:, :1].copy()
        cell -= first
        lattice = first + np.arange(int(cell[:, -1].max()) + 2)
        t = rest.astype(np.float32) * (1 / self._scale).astype(np.float32)
        return lattice, cell, t * t * t * (t * (t * np.float32(6) - np.float32(15)) + np.float32(10))


def enlarge(coarse: Field, x: Axis, z: Axis, spacing: int) -> Field:
    """Interpolate fields known every `spacing` blocks, from the one at or before the first place, to all places."""
    i, x_weight = np.divmod(x.ravel(), spacing)
    j, z_weight = np.divmod(z.ravel(), spacing)
    i -= i[0]
    skipped, last = int(z_weight[0]), int(j[-1] - j[0]) + 1
    low = coarse.take(i, axis=-2)
    rows = (coarse.take(i + 1, axis=-2) - low) * (x_weight.astype(np.float32) / np.float32(spacing))[:, None] + low
    slope = rows[..., 1 : last + 1] - rows[..., :last]
    span = slice(skipped, skipped + len(j))
    field: Field = slope.repeat(spacing, axis=-1)[..., span]
    field *= z_weight.astype(np.float32) / np.float32(spacing)
    field += rows[..., :last].repeat(spacing, axis=-1)[..., span]
    return field
