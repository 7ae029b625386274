"""The noise of compiled worlds: an approximation of whole rows of cells, and the exact value at single cells.

The rules of `worldgen` only compare noise with thresholds. An approximation whose error is at most `SLACK` answers the
same as the exact value wherever it is farther than that from the threshold, which is nearly everywhere; the few cells
where it is not are computed once more, exactly. So worlds are the same to the last bit, for a fraction of the time.
This is known as a floating-point filter.

The approximation is in single precision, and adds its terms in another order: along the cells of a row, the offset from
a lattice corner grows by the same step. A corner's contribution to a row is thus a line times a weight, and the
processor adds many cells at once.
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smartplay_tools.games.crafter.compiled.jit import approximate, kernel
from smartplay_tools.games.crafter.compiled.layout import Records, one_record
from smartplay_tools.games.crafter.facts import AREA
from smartplay_tools.games.crafter.noise import GRADIENTS, SCALE, Contributions
from smartplay_tools.games.crafter.worldgen import CELLS, FIELDS, points

SLACK = 1e-5
"""More than the error of anything that is compared with a threshold (see `terrain.sort_cell`).

A noise is a sum over up to eight corners and three axes of |gradient| * |offset| * weight / 103, at most 2.5 at any
point, and at most 1 once the axes are added. Up to there a term has seven roundings, each by a factor of at most
2 ** -24, and then there are eight sums: the error is below 1.6e-6. That of the nearness to the center, whose slope is
1/4 of twice the noise, is below 1.2e-6; that of water, at 1.15 noises and 2 of these, below 5e-6; that of mountains, at
a noise, 4 nearnesses and 0.3 waters, below 9e-6, with the roundings of numbers below 4.
"""

BLOCK = 32
"""The cells of a row that are computed at once; long enough that compilers do not unroll the loop over them."""

_GRADIENTS = GRADIENTS.astype(np.float32)
_FACTOR, _SUMMAND = np.uint64(6364136223846793005), np.uint64(1442695040888963407)
_RAMP = np.arange(BLOCK).astype(np.float32)
_ONE = np.uint64(1)

LINE = np.dtype(
    [
        ("cells", "u8"),  # the cells of the row with a weight above 0, as bits
        ("x", "f4"),  # the offset of the middle cell from the corner
        ("y", "f4"),
        ("z", "f4"),
        ("middle", "f4"),  # the middle cell, counted from the block's first
        ("begin", "u2"),  # the first cell of the block in its row
        ("corner", "u2"),
    ],
    align=True,
)
"""The contribution of a lattice corner to a block of cells."""


@functools.cache
def geometry() -> Records:
    """One record with the part of all noise that does not depend on the seed, computed once per process."""
    by_point = points().by_point()
    x, y, z = (coordinate.astype(np.uint8) for coordinate in by_point.cells)
    steps = np.array([y[1] - y[0] for _, y, _ in FIELDS.values()])
    rows, lines, weights = _lines(by_point, steps)
    return one_record(
        # The lattice corners, by their coordinates modulo 256.
        x=x,
        y=y,
        z=z,
        # For the exact sums: the first contribution to each point; the corner of each, its offset and its weight.
        starts=by_point.starts.astype(np.uint32),
        contributors=by_point.corners.astype(np.uint16),
        reach=np.concatenate([by_point.distance, by_point.weight[:, None]], axis=1),
        # For the approximation: the first line of each row of each field; the lines, and their weights by cell; the
        # distance between neighbours in a row, by field.
        rows=rows,
        lines=lines,
        weights=weights,
        steps=steps.astype(np.float32),
    )


def _lines(by_point: Contributions, steps: NDArray[np.float64]) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """The first line of each row, all lines in the order of rows, and their weights."""
    point = np.repeat(np.arange(len(by_point.starts) - 1), np.diff(by_point.starts))
    names, line = np.unique(point // BLOCK << 16 | by_point.corners, return_inverse=True)
    cell = point % AREA
    weights = np.zeros((len(names), BLOCK), np.float32)
    weights[line, cell % BLOCK] = by_point.weight / SCALE
    lines = np.zeros(len(names), LINE)
    np.bitwise_or.at(lines["cells"], line, _ONE << cell.astype(np.uint64))
    lines["corner"] = names & 0xFFFF
    lines["begin"] = (names >> 16) * BLOCK % AREA
    middle = np.bincount(line, cell % BLOCK) // np.bincount(line)
    lines["middle"] = middle
    # All cells of a line give the same offset of the middle one, but for rounding.
    for axis, name in enumerate(("x", "y", "z")):
        lines[name][line] = by_point.distance[:, axis]
    lines["y"][line] = by_point.distance[:, 1] - (cell % BLOCK - middle[line]) * steps[point // CELLS]
    rows = np.searchsorted((names >> 16) * BLOCK // AREA, np.arange(len(FIELDS) * AREA + 1))
    return rows.astype(np.uint32), lines, weights


@kernel
def shuffle_corners(seed: int, geometry: Any, slopes: Any) -> None:
    """Choose the gradient of every lattice corner: one of 24, by the seed's shuffle of 0..255."""
    left, shuffled = np.empty(256, np.uint8), np.empty(256, np.uint8)
    for number in range(256):
        left[number] = number
    state = np.uint64(seed)
    for _ in range(3):
        state = state * _FACTOR + _SUMMAND
    for last in range(255, -1, -1):
        state = state * _FACTOR + _SUMMAND
        choice = (np.int64(state) + 31) % (last + 1)
        shuffled[last] = left[choice]
        left[choice] = left[last]
    x, y, z = geometry.x, geometry.y, geometry.z
    for corner in range(len(x)):
        chosen = shuffled[(shuffled[(shuffled[x[corner]] + y[corner]) & 255] + z[corner]) & 255] % 24
        for axis in range(3):
            slopes[corner, axis] = _GRADIENTS[chosen, axis]


@kernel
def exact(point: int, geometry: Any, slopes: Any) -> float:
    """The noise at a point; the sum is in the order of `noise.Points.values`."""
    total = 0.0
    for i in range(geometry.starts[point], geometry.starts[point + 1]):
        corner = geometry.contributors[i]
        term = slopes[corner, 0] * geometry.reach[i, 0]
        term += slopes[corner, 1] * geometry.reach[i, 1]
        term += slopes[corner, 2] * geometry.reach[i, 2]
        total += term * geometry.reach[i, 3]
    return total / SCALE


@approximate
def fill(fields: Any, wanted: Any, geometry: Any, noise: Any) -> None:
    """Approximate the noise of some fields at the wanted cells; at other cells, the result means nothing.

    `noise` has the gradients of the corners, the array for the results, and a buffer for one number by row.
    """
    rows = noise.rows
    for row in range(AREA):
        cells = np.uint64(0)
        for cell in range(AREA):
            cells |= np.uint64(wanted[row * AREA + cell]) << np.uint64(cell)
        rows[row] = cells
    for field in fields:
        total = noise.fields[field]
        for row in range(AREA):
            if rows[row]:
                _fill_row(field, row, rows[row], geometry, noise.slopes, total)


@approximate
def _fill_row(field: int, row: int, cells: int, geometry: Any, slopes: Any, total: Any) -> None:
    """Approximate a field in a row, by adding all lines that reach one of the cells."""
    first, step = row * AREA, geometry.steps[field]
    lines, weights = geometry.lines, geometry.weights
    total[first : first + AREA] = np.float32(0)
    for i in range(geometry.rows[field * AREA + row], geometry.rows[field * AREA + row + 1]):
        line = lines[i]
        if not line.cells & cells:
            continue
        corner = line.corner
        value = slopes[corner, 0] * line.x + slopes[corner, 1] * line.y + slopes[corner, 2] * line.z
        rise = slopes[corner, 1] * step
        # An unsigned index, for which the compiler need not check whether it counts from the array's end.
        begin, before = np.uint64(first) + np.uint64(line.begin), line.middle
        for cell in range(BLOCK):
            total[begin + np.uint64(cell)] += (value + rise * (_RAMP[cell] - before)) * weights[i, cell]
