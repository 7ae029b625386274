"""Hashes and smooth fields over the plane, whose values do not depend on the rectangle that is computed.

Only integer arithmetic, +, -, * and / are used, which give the same bits on every machine. Places are integer
coordinates, given as a column of x and a row of z; results are [x, z].
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
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
    """Blocks between the random values of the first field; half as many, rounded down, of the next."""
    octaves: int
    east: int = 0
    south: int = 0
    """By how many blocks the result is that of a place further east and south."""


class Noise:
    """Several fractals in [-1, 1], which are computed together: for a small rectangle, the calls of NumPy are the cost.

    A smooth field is made of random values `scale` blocks apart, joined by quintic curves. All octaves of all fractals
    are the layers, along the first axis of the arrays.
    """

    def __init__(self, *fractals: Fractal) -> None:
        self._octaves = [fractal.octaves for fractal in fractals]
        layers = [(fractal, octave) for fractal in fractals for octave in range(fractal.octaves)]
        self._salts = [fractal.salt * 16 + octave for fractal, octave in layers]
        self._scale = np.array([max(fractal.scale >> octave, 1) for fractal, octave in layers])[:, None]
        self._east = np.array([fractal.east for fractal, _ in layers])[:, None]
        self._south = np.array([fractal.south for fractal, _ in layers])[:, None]
        self._strength = np.array([0.5**octave for _, octave in layers], np.float32)[:, None, None]

    def __call__(self, seed: int, x: Axis, z: Axis) -> list[Field]:
        """The fractals at the given places."""
        west, i, x_weight = self._cells(x.ravel() + self._east)
        north, j, z_weight = self._cells(z.ravel() + self._south)
        salts = np.array([_mixed(seed, salt) for salt in self._salts], np.uint32)[:, None, None]
        corners = unit(_scrambled(west[:, :, None], north[:, None, :], salts)) * np.float32(2) - np.float32(1)
        layer = np.arange(len(self._salts))[:, None]
        rows = _between(corners[layer, i], corners[layer, i + 1], x_weight)
        # Now z comes first in memory, so that this second interpolation, the large one, gathers whole rows.
        rows = rows.swapaxes(1, 2).copy()
        fields = _between(rows[layer, j], rows[layer, j + 1], z_weight)
        fields *= self._strength
        each = iter(fields.swapaxes(1, 2))
        return [self._total(each, octaves) for octaves in self._octaves]

    @staticmethod
    def _total(fields: Iterator[Field], octaves: int) -> Field:
        """The next fractal. Octaves are added one by one: NumPy's sums leave their order open, and so the last bit."""
        total = next(fields)
        for field in itertools.islice(fields, octaves - 1):
            total += field
        total *= np.float32(1 / (2 - 0.5 ** (octaves - 1)))
        return total

    def _cells(self, places: Axis) -> tuple[Axis, Axis, Field]:
        """By layer: the lattice's coordinates, and for every place its cell of the lattice and its weight there."""
        cell, rest = np.divmod(places, self._scale)
        first = cell[:, :1].copy()
        cell -= first
        lattice = first + np.arange(int(cell[:, -1].max()) + 2)
        t: Any = rest.astype(np.float32) * (1 / self._scale).astype(np.float32)
        weight: Field = t * t * t * (t * (t * np.float32(6) - np.float32(15)) + np.float32(10))
        return lattice, cell, weight


def _between(low: Field, high: Field, weight: Field) -> Field:
    """Interpolate linearly along the second axis; `high` is overwritten."""
    high -= low
    high *= weight[:, :, None]
    high += low
    return high


def enlarge(coarse: Field, x: Axis, z: Axis, spacing: int) -> Field:
    """Interpolate fields known every `spacing` blocks, from the one at or before the first place, to all places."""
    i, x_weight = np.divmod(x.ravel(), spacing)
    j, z_weight = np.divmod(z.ravel(), spacing)
    i -= i[0]
    skipped, last = int(z_weight[0]), int(j[-1] - j[0]) + 1
    coarse = coarse.swapaxes(-1, -2)
    low = coarse.take(i, axis=-1)
    rows = coarse.take(i + 1, axis=-1) - low
    rows *= x_weight.astype(np.float32) / np.float32(spacing)
    rows += low
    span = slice(skipped, skipped + len(j))
    field: Field = (rows[..., 1 : last + 1, :] - rows[..., :last, :]).repeat(spacing, axis=-2)[..., span, :]
    field *= (z_weight.astype(np.float32) / np.float32(spacing))[:, None]
    field += rows[..., :last, :].repeat(spacing, axis=-2)[..., span, :]
    return field.swapaxes(-1, -2)
