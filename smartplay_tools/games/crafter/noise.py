"""Simplex noise in three dimensions at fixed points, equal to that of the `opensimplex` package bit for bit.

The noise at a point is a sum over up to eight corners of a skewed lattice around it. Which corners these are, how far
away they lie and how much they weigh depends on the point alone; the seed only chooses the gradient at each corner. A
world needs the noise at the same 53,248 points whatever its seed. `Points` therefore computes the geometry once per
process, and `Points.values` only looks up gradients and adds.

For bitwise equality, sums are in the library's order. For some corners it also subtracts the skew in the middle of an
offset; at the points of a world, which never change, that rounds to the same bits.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]

STRETCH = -1.0 / 6
SQUISH = 1.0 / 3
MOST_CORNERS = 14
CONTRIBUTING = 8
"""The most corners that may contribute to a point, and the most that do."""
SCALE = 103
"""The sum of all contributions is divided by this."""

_SHAPES = ((11, 4, 4), (4, 11, 4), (4, 4, 11))
_SIGNS = ((-1, 1, 1), (1, 1, 1), (-1, -1, 1), (1, -1, 1), (-1, 1, -1), (1, 1, -1), (-1, -1, -1), (1, -1, -1))
GRADIENTS = np.array(
    [[s * v for s, v in zip(signs, shape, strict=True)] for signs in _SIGNS for shape in _SHAPES], np.float64
)
"""The 24 directions that a corner's gradient can have."""


# --- The gradients of a seed -----------------------------------------------------------------------------------------

_FACTOR, _SUMMAND = 6364136223846793005, 1442695040888963407


def _powers(rounds: int) -> tuple[NDArray[np.uint64], NDArray[np.uint64]]:
    """Factors and summands that take a seed through 1, 2, ... rounds of the linear congruential generator."""
    factor, summand, factors, summands = 1, 0, [], []
    for _ in range(rounds):
        factor, summand = factor * _FACTOR % 2**64, (summand * _FACTOR + _SUMMAND) % 2**64
        factors.append(factor)
        summands.append(summand)
    return np.array(factors, np.uint64), np.array(summands, np.uint64)


# The first three rounds only mix the seed; the next 256 are used for choices.
_FACTORS, _SUMMANDS = (array[3:] for array in _powers(259))
_REMAINING = np.arange(256, 0, -1, dtype=np.int64)


def permutation(seed: int) -> Integers:
    """The seed's shuffle of 0..255, on which its noise depends."""
    numbers = (_FACTORS * np.uint64(seed) + _SUMMANDS).view(np.int64)
    choices = ((numbers + 31) % _REMAINING).tolist()
    left, shuffled = list(range(256)), [0] * 256
    for place, choice in zip(range(255, -1, -1), choices, strict=True):
        shuffled[place], left[choice] = left[choice], left[place]
    return np.array(shuffled, np.int64)


# --- The corners around a point --------------------------------------------------------------------------------------

Offset = tuple[int, int, int]
"""A lattice corner relative to the corner at the base of a point's cell."""

# A cell falls into two tetrahedra, at its base and at its opposite corner, and an octahedron in the middle. Each
# contributes its own corners first.
BASE, MIDDLE, OPPOSITE = range(3)
_OWN = {
    BASE: ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)),
    OPPOSITE: ((1, 1, 0), (1, 0, 1), (0, 1, 1), (1, 1, 1)),
    MIDDLE: ((1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (1, 0, 1), (0, 1, 1)),
}
# Two more corners outside contribute. In a tetrahedron they follow from its two corners nearest to the point; an
# own corner is named by the axes along which it lies away from the base: 1 for x, 2 for y, 4 for z, and sums of them.
# In the octahedron they are those of eight that are near enough.
_AXIS = {1: (1, 0, 0), 2: (0, 1, 0), 4: (0, 0, 1)}
_TWICE = {1: (2, 0, 0), 2: (0, 2, 0), 4: (0, 0, 2)}
_WITHOUT = {6: (-1, 1, 1), 5: (1, -1, 1), 3: (1, 1, -1)}
_BASE_WITH = {1: ((1, -1, 0), (1, 0, -1)), 2: ((-1, 1, 0), (0, 1, -1)), 4: ((-1, 0, 1), (0, -1, 1))}
_BASE_WITHOUT = {3: (1, 1, 0), 5: (1, 0, 1), 6: (0, 1, 1)}
_OPPOSITE_WITH = {3: ((2, 1, 0), (1, 2, 0)), 5: ((2, 0, 1), (1, 0, 2)), 6: ((0, 2, 1), (0, 1, 2))}


def _extra_corners() -> dict[tuple[int, int, int], tuple[Offset, ...]]:
    """The outside corners by case, (region, side, axes) as in `_cases`."""
    extra: dict[tuple[int, int, int], tuple[Offset, ...]] = {}
    extra[MIDDLE, 0, 0] = (1, 1, 1), (0, 0, 0), *_WITHOUT.values(), *_TWICE.values()
    for axis in (1, 2, 4):
        extra[BASE, 0, axis] = _BASE_WITH[axis]
        extra[OPPOSITE, 7, axis] = _AXIS[axis], _TWICE[axis]
    for pair in (3, 5, 6):
        extra[BASE, 7, pair] = _BASE_WITHOUT[pair], _WITHOUT[pair]
        extra[OPPOSITE, 0, pair] = _OPPOSITE_WITH[pair]
    return extra


def _tetrahedron_case(own: Floats, others: list[Floats], names: tuple[int, int, int]) -> tuple[Integers, Integers]:
    """The case of points in a tetrahedron, as (side, axes).

    Side: 0 if the tetrahedron's corner on the cell is one of the two nearest, else 7. Axes: the name of the nearest
    other corner, or what the two nearest have in common. `own` is the score of the corner on the cell, `others` of the
    other three.
    """
    first, second, third = others
    first_yields = first < second
    into_first, into_second = first_yields & (first < third), ~first_yields & (second < third)
    a, b = np.where(into_first, names[2], names[0]), np.where(into_second, names[2], names[1])
    first, second = np.where(into_first, third, first), np.where(into_second, third, second)
    own_is_near = (own > first) | (own > second)
    both = a | b if names[0] == 1 else a & b
    return np.where(own_is_near, 0, 7), np.where(own_is_near, np.where(second > first, b, a), both)


def _cases(inside: list[Floats]) -> Integers:
    """The case of every point, from its coordinates inside its cell: region * 64 + side * 8 + axes."""
    x, y, z = inside
    total = x + y + z
    cases = np.full(total.shape, MIDDLE * 64)
    for region, here, (side, axes) in (
        (BASE, total <= 1, _tetrahedron_case(1 - total, [x, y, z], (1, 2, 4))),
        # At the opposite corner, the comparisons are those of the base with reversed signs.
        (OPPOSITE, total >= 2, _tetrahedron_case(total - 3, [-x, -y, -z], (6, 5, 3))),
    ):
        cases[here] = (region * 64 + side * 8 + axes)[here]
    return cases


def _corner_table() -> tuple[Integers, Flags]:
    """Offsets and presence of the corners that may contribute, by case."""
    offsets, present = np.zeros((192, MOST_CORNERS, 3), np.int64), np.zeros((192, MOST_CORNERS), np.bool_)
    for (region, side, axes), extra in _extra_corners().items():
        case = region * 64 + side * 8 + axes
        corners = [*_OWN[region], *extra]
        offsets[case, : len(corners)] = corners
        present[case, : len(corners)] = True
    return offsets, present


# --- Noise at fixed points -------------------------------------------------------------------------------------------


class Points:
    """Points at which the noise of any seed can be computed: a few operations on arrays for each corner."""

    def __init__(self, x: Floats, y: Floats, z: Floats) -> None:
        lattice, distance = self._reach(x, y, z)
        closeness = 2 - distance[0] * distance[0] - distance[1] * distance[1] - distance[2] * distance[2]
        first = (closeness <= 0).argsort(axis=1, kind="stable")[:, :CONTRIBUTING]
        lattice = np.take_along_axis(lattice, first, axis=1)
        closeness, *distance = (np.take_along_axis(each, first, axis=1) for each in (closeness, *distance))
        squared = np.where(closeness > 0, closeness, 0) ** 2
        cells, corner = np.unique(lattice, return_inverse=True)
        self._cells = cells >> 16, cells >> 8 & 255, cells & 255
        self._corners = np.ascontiguousarray(corner.reshape(lattice.shape).T)
        """By corner and point: where its gradient is found. Of those that do not contribute the weight is 0."""
        self._distances = [np.ascontiguousarray(axis.T) for axis in distance]
        self._weights = np.ascontiguousarray((squared * squared).T)

    @staticmethod
    def _reach(x: Floats, y: Floats, z: Floats) -> tuple[Integers, list[Floats]]:
        """The lattice corners (one number each) that may contribute to each point, and their offsets by axis.

        A missing corner is put so far away that it cannot contribute.
        """
        stretch = (x + y + z) * STRETCH
        stretched = [v + stretch for v in (x, y, z)]
        base = [np.floor(v) for v in stretched]
        squish = (base[0] + base[1] + base[2]) * SQUISH
        from_base = [v - (b + squish) for v, b in zip((x, y, z), base, strict=True)]
        case = _cases([s - b for s, b in zip(stretched, base, strict=True)])
        offsets, present = (table[case] for table in _corner_table())
        skew = offsets.sum(2) * SQUISH
        lattice = np.zeros(skew.shape, np.int64)
        distance = []
        for axis in range(3):
            way = from_base[axis][:, None] - offsets[:, :, axis] - skew
            distance.append(np.where(present, way, 9.0))
            reached = base[axis][:, None].astype(np.int64) + offsets[:, :, axis]
            lattice = lattice << 8 | reached & 255
        return lattice, distance

    def values(self, seed: int) -> Floats:
        """The noise of a seed at all points."""
        shuffled = permutation(seed)
        x, y, z = self._cells
        chosen = GRADIENTS[shuffled[(shuffled[(shuffled[x] + y) & 255] + z) & 255] % 24]
        gradient = [np.ascontiguousarray(chosen[:, axis]) for axis in range(3)]
        total = np.zeros(self._weights.shape[1])
        for corner, weight, *distance in zip(self._corners, self._weights, *self._distances, strict=True):
            product = gradient[0][corner] * distance[0]
            for axis in (1, 2):
                product += gradient[axis][corner] * distance[axis]
            product *= weight
            total += product
        return total / SCALE
