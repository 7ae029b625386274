"""The terrain of a compiled world as its noise alone has it: the rules of `worldgen`, cell by cell.

`worldgen` computes the noise of all cells in all fields, because numpy needs whole arrays. Here a field is computed
only where it can matter: approximately first, and exactly at the few cells where that leaves a comparison undecided
(see `noise`).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from smartplay_tools.games.crafter.compiled.jit import approximate, inlined, kernel
from smartplay_tools.games.crafter.compiled.layout import KEY, Records, one_record
from smartplay_tools.games.crafter.compiled.noise import exact, fill, geometry
from smartplay_tools.games.crafter.facts import AREA, GRASS, LAVA, PATH, SAND, STONE, WATER
from smartplay_tools.games.crafter.worldgen import CELLS, FIELDS, FROM_CENTER

(
    _START,
    _WATER,
    _WATER_DETAIL,
    _MOUNTAIN,
    _MOUNTAIN_DETAIL,
    _CAVE,
    _HORIZONTAL_TUNNEL,
    _VERTICAL_TUNNEL,
    _COAL,
    _IRON,
    _LAVA,
    _SAND,
    _TREE,
) = range(len(FIELDS))
# Which fields are computed together, for the same cells.
_OF_CENTER = np.array((_START,))
_EVERYWHERE = np.array((_WATER, _WATER_DETAIL, _MOUNTAIN, _MOUNTAIN_DETAIL))
_OF_DEEP_ROCK = np.array((_CAVE, _LAVA))
_OF_ROCK = np.array((_HORIZONTAL_TUNNEL, _VERTICAL_TUNNEL, _COAL, _IRON))
_OF_SHORE, _OF_LAND = np.array((_SAND,)), np.array((_TREE,))

_AROUND_CENTER = FROM_CENTER < 21
"""Elsewhere the nearness to the center is below 3e-7, since noise is below 1, and taken for 0."""
_IS_AROUND_CENTER = _AROUND_CENTER.astype(np.uint8)
_CELLS_AROUND_CENTER = np.flatnonzero(_AROUND_CENTER)
_DISTANCES = FROM_CENTER[_AROUND_CENTER].astype(np.float32)
_ANYWHERE = np.ones(CELLS, np.uint8)

# What is compared with noise, in the order of `worldgen`.
_MEADOW, _MOUNTAINS, _DEEP, _IN_CAVE, _IN_TUNNEL = 0.5, 0.15, 0.3, 0.15, 0.4
_HAS_COAL, _HAS_IRON, _HAS_DIAMOND, _HAS_LAVA = 0.0, 0.4, 0.18, 0.35
_BEACH, _SHORE, _LAKE, _IS_SANDY, _HAS_TREE = 0.25, 0.35, 0.3, -0.2, 0.0

# What a cell's terrain has in addition to its material: the numbers drawn for it, in their order, and whether it is a
# tunnel.
ASKS_COAL, ASKS_IRON, ASKS_DIAMOND, ASKS_TREE, IS_TUNNEL = 1, 2, 4, 8, 16
# Which values are too close to a threshold: those of land, water and mountains, or those of the other fields.
_UNSURE_GROUND, _UNSURE_REST = 1, 2


def new_terrain() -> Records:
    """One record with the terrain of a world by cell, and with buffers for making it."""
    cells = np.zeros(CELLS, np.uint8)
    return one_record(
        materials=cells,
        asks=cells,
        # The gradient of each lattice corner, by axis.
        slopes=np.zeros((len(geometry()["x"][0]), 3), np.float32),
        # The approximate noise, by field and cell, and the nearness to the center.
        fields=np.zeros((len(FIELDS), CELLS), np.float32),
        start=np.zeros(CELLS, np.float32),
        # Which cells a field is computed for, for four groups of fields.
        wanted=np.zeros((4, CELLS), np.uint8),
        # Which cells the approximation is not enough for; then a list of these cells, and their exact noise `start`.
        unsure=cells,
        cells=np.zeros(CELLS, np.uint16),
        starts=np.zeros(CELLS),
        # The wanted cells of each row as bits, see `noise.fill`; random words, see `twister.next_uniform`.
        rows=np.zeros(AREA, np.uint64),
        words=np.zeros(KEY, np.uint32),
    )


@approximate
def _approximate_start(geometry: Any, terrain: Any) -> None:
    """The nearness to the center, as in `worldgen.nearness`; it stays 0 at cells far away."""
    fill(_OF_CENTER, _IS_AROUND_CENTER, geometry, terrain)
    for i in range(len(_CELLS_AROUND_CENTER)):
        cell = _CELLS_AROUND_CENTER[i]
        start = np.float32(4) - _DISTANCES[i] + np.float32(2) * terrain.fields[_START, cell]
        terrain.start[cell] = np.float32(1) / (np.float32(1) + np.exp(-start))


@approximate
def _approximate_fields(geometry: Any, terrain: Any) -> None:
    """Approximate the noise; fields that only some cells need are computed around these only."""
    fill(_EVERYWHERE, _ANYWHERE, geometry, terrain)
    start, wanted = terrain.start, terrain.wanted
    rock, deep, shore, land = wanted[0], wanted[1], wanted[2], wanted[3]
    waters, mountains, caves = terrain.fields[_WATER], terrain.fields[_MOUNTAIN], terrain.fields[_CAVE]
    water_details, mountain_details = terrain.fields[_WATER_DETAIL], terrain.fields[_MOUNTAIN_DETAIL]
    for cell in range(CELLS):
        water = waters[cell] + np.float32(0.15) * water_details[cell] + np.float32(0.1)
        water -= np.float32(2) * start[cell]
        mountain = (mountains[cell] + np.float32(0.3) * mountain_details[cell]) / np.float32(1.3)
        mountain -= np.float32(4) * start[cell] + np.float32(0.3) * water
        waters[cell] = water
        mountains[cell] = mountain
        outside = start[cell] <= _MEADOW
        rock[cell] = outside & (mountain > _MOUNTAINS)
        deep[cell] = outside & (mountain > _DEEP)
        low = outside & (mountain <= _MOUNTAINS) & (water <= _SHORE)
        land[cell] = low
        shore[cell] = low & (water > _BEACH)
    fill(_OF_DEEP_ROCK, deep, geometry, terrain)
    for cell in range(CELLS):
        rock[cell] &= not (deep[cell] & (caves[cell] > _IN_CAVE))
    fill(_OF_ROCK, rock, geometry, terrain)
    fill(_OF_SHORE, shore, geometry, terrain)
    fill(_OF_LAND, land, geometry, terrain)


@inlined
def _is_close(value: float, threshold: float, slack: float) -> bool:
    return abs(value - threshold) <= slack


@inlined
def sort_cell(
    start: float,
    water: float,
    mountain: float,
    cave: float,
    horizontal: float,
    vertical: float,
    coal: float,
    iron: float,
    lava: float,
    sand: float,
    tree: float,
    slack: float,
) -> tuple[int, int, int]:
    """The material of a cell, which numbers are drawn for another, and which values are too close to decide that.

    Without branches: the processor could not predict them, and so it can sort many cells at once.
    """
    outside = start <= _MEADOW
    mountainous, deep = outside & (mountain > _MOUNTAINS), outside & (mountain > _DEEP)
    in_cave = deep & (cave > _IN_CAVE)
    beside_cave = mountainous & (not in_cave)
    in_horizontal = horizontal > _IN_TUNNEL
    tunnel = beside_cave & (in_horizontal | (vertical > _IN_TUNNEL))
    rock = beside_cave & (not tunnel)
    has_lava = rock & deep & (lava > _HAS_LAVA)
    low = outside & (not mountainous)
    shore = low & (water > _BEACH) & (water <= _SHORE)
    beach = shore & (sand > _IS_SANDY)
    lake = low & (not beach) & (water > _LAKE)
    land = low & (not beach) & (not lake)
    material = (
        GRASS
        + (PATH - GRASS) * (in_cave | tunnel)
        + (STONE - GRASS) * (rock & (not has_lava))
        + (LAVA - GRASS) * has_lava
        + (SAND - GRASS) * beach
        + (WATER - GRASS) * lake
    )
    asks = (
        ASKS_COAL * (rock & (coal > _HAS_COAL))
        + ASKS_IRON * (rock & (iron > _HAS_IRON))
        + ASKS_DIAMOND * (rock & (mountain > _HAS_DIAMOND))
        + ASKS_TREE * (land & (tree > _HAS_TREE))
        + IS_TUNNEL * tunnel
    )
    ground = _is_close(start, _MEADOW, slack)
    ground |= outside & (_is_close(mountain, _MOUNTAINS, slack) | _is_close(mountain, _DEEP, slack))
    ground |= low & (_is_close(water, _BEACH, slack) | _is_close(water, _SHORE, slack) | _is_close(water, _LAKE, slack))
    ground |= rock & _is_close(mountain, _HAS_DIAMOND, slack)
    rest = deep & _is_close(cave, _IN_CAVE, slack)
    rest |= beside_cave & (_is_close(horizontal, _IN_TUNNEL, slack) | _is_close(vertical, _IN_TUNNEL, slack))
    rest |= rock & (_is_close(coal, _HAS_COAL, slack) | _is_close(iron, _HAS_IRON, slack))
    rest |= (rock & deep & _is_close(lava, _HAS_LAVA, slack)) | (shore & _is_close(sand, _IS_SANDY, slack))
    rest |= land & _is_close(tree, _HAS_TREE, slack)
    return material, asks, _UNSURE_REST * rest + _UNSURE_GROUND * ground


@kernel
def _sort_cells(terrain: Any, slack: float) -> None:
    start, fields = terrain.start, terrain.fields
    materials, asks, unsure = terrain.materials, terrain.asks, terrain.unsure
    waters, mountains, caves, lavas = fields[_WATER], fields[_MOUNTAIN], fields[_CAVE], fields[_LAVA]
    horizontal, vertical = fields[_HORIZONTAL_TUNNEL], fields[_VERTICAL_TUNNEL]
    coals, irons, sands, trees = fields[_COAL], fields[_IRON], fields[_SAND], fields[_TREE]
    for cell in range(CELLS):
        materials[cell], asks[cell], unsure[cell] = sort_cell(
            start[cell],
            waters[cell],
            mountains[cell],
            caves[cell],
            horizontal[cell],
            vertical[cell],
            coals[cell],
            irons[cell],
            lavas[cell],
            sands[cell],
            trees[cell],
            slack,
        )


@kernel
def _settle(cell: int, start: float, water: float, mountain: float, geometry: Any, terrain: Any) -> None:
    """Sort a cell again, by the exact noise of all other fields."""
    terrain.materials[cell], terrain.asks[cell], _ = sort_cell(
        start,
        water,
        mountain,
        _noise(_CAVE, cell, geometry, terrain),
        _noise(_HORIZONTAL_TUNNEL, cell, geometry, terrain),
        _noise(_VERTICAL_TUNNEL, cell, geometry, terrain),
        _noise(_COAL, cell, geometry, terrain),
        _noise(_IRON, cell, geometry, terrain),
        _noise(_LAVA, cell, geometry, terrain),
        _noise(_SAND, cell, geometry, terrain),
        _noise(_TREE, cell, geometry, terrain),
        0.0,
    )


@kernel
def sketch(geometry: Any, terrain: Any, slack: float) -> int:
    """Sort all cells; return how many need the exact nearness to the center, for `settle`."""
    _approximate_start(geometry, terrain)
    _approximate_fields(geometry, terrain)
    _sort_cells(terrain, slack)
    start, fields, count = terrain.start, terrain.fields, 0
    for cell in range(CELLS):
        unsure = terrain.unsure[cell]
        if unsure & _UNSURE_GROUND:
            terrain.cells[count] = cell
            terrain.starts[count] = _noise(_START, cell, geometry, terrain)
            count += 1
        elif unsure:
            _settle(cell, start[cell], fields[_WATER, cell], fields[_MOUNTAIN, cell], geometry, terrain)
    return count


@kernel
def settle(near: Any, geometry: Any, terrain: Any) -> None:
    """Sort the cells that need it by exact values alone. `near` is the nearness of each to the center."""
    for i in range(len(near)):
        cell, start = int(terrain.cells[i]), near[i]
        water = _noise(_WATER, cell, geometry, terrain) + 0.15 * _noise(_WATER_DETAIL, cell, geometry, terrain) + 0.1
        water -= 2 * start
        mountain = _noise(_MOUNTAIN, cell, geometry, terrain)
        mountain = (mountain + 0.3 * _noise(_MOUNTAIN_DETAIL, cell, geometry, terrain)) / 1.3
        mountain -= 4 * start + 0.3 * water
        _settle(cell, start, water, mountain, geometry, terrain)


@kernel
def _noise(field: int, cell: int, geometry: Any, terrain: Any) -> float:
    return exact(field * CELLS + cell, geometry, terrain.slopes)
