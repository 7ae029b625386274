"""Plants: trees, cacti, spikes of ice and whatever else stands on the ground.

A shape is a list of cells around the foot of the plant. Trunks go through other plants, foliage fills only air, and
plants far outside the generated rectangle cannot reach into it: `REACH` bounds every shape.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from smartplay_tools.games.minecraft.voxel.blocks import SOLID, Block
from smartplay_tools.games.minecraft.voxel.climate import BIOMES, Biome

REACH = 4
"""No shape reaches further from its foot, along x or z."""

Cell = tuple[int, int, int]
Cells = Mapping[Cell, Block]


@dataclass(frozen=True)
class Shape:
    """Cells (dx, dy, dz, block) of a plant whose foot is at 0, 0, 0."""

    trunk: NDArray[np.int32]
    foliage: NDArray[np.int32]


def _shape(trunk: Cells, foliage: Cells | None = None) -> Shape:
    def table(cells: Cells) -> NDArray[np.int32]:
        rows = [(*cell, int(block)) for cell, block in sorted(cells.items())]
        return np.array(rows, np.int32).reshape(-1, 4)

    return Shape(table(trunk), table({c: b for c, b in (foliage or {}).items() if c not in trunk}))


def _pole(block: Block, height: int, thick: int = 1) -> dict[Cell, Block]:
    return {(x, y, z): block for x in range(thick) for z in range(thick) for y in range(height)}


def _disc(block: Block, y: int, radius: float, thick: int = 1) -> dict[Cell, Block]:
    """A round layer around a pole of that thickness."""
    middle, reach = (thick - 1) / 2, int(radius) + 1
    span = range(-reach, reach + thick)
    return {
        (x, y, z): block for x in span for z in span if (x - middle) ** 2 + (z - middle) ** 2 <= (radius + 0.3) ** 2
    }


def _crown(block: Block, layers: Iterable[tuple[int, float]], thick: int = 1) -> dict[Cell, Block]:
    return {cell: b for y, radius in layers for cell, b in _disc(block, y, radius, thick).items()}


def _round_tree(wood: Block, leaves: Block, height: int) -> Shape:
    top = height + 1
    layers = [(top, 1), (top - 1, 1), (top - 2, 2.2), (top - 3, 2.2)]
    return _shape(_pole(wood, height + 1), _crown(leaves, layers))


def _spruce(height: int) -> Shape:
    layers = [(y, (height - y) % 3 * 0.6 + min(height - y, 6) * 0.2) for y in range(2, height + 1)]
    return _shape(_pole(Block.SPRUCE_WOOD, height), _crown(Block.SPRUCE_LEAVES, layers))


def _dark_oak(height: int) -> Shape:
    layers = [(height + 1, 2.0), (height, 3.2), (height - 1, 3.2)]
    return _shape(_pole(Block.DARK_OAK_WOOD, height, 2), _crown(Block.DARK_OAK_LEAVES, layers, 2))


def _jungle_tree(height: int) -> Shape:
    layers = [(height + 1, 1), (height, 2.2), (height - 1, 2.2), (height - 2, 2.2)]
    crown = _crown(Block.JUNGLE_LEAVES, layers)
    vines = {(x, y, z): Block.VINES for x, z in ((1, 0), (0, -1)) for y in range(2, height - 2)}
    return _shape(_pole(Block.JUNGLE_WOOD, height + 1), {**vines, **crown})


def _great_jungle_tree(height: int) -> Shape:
    crown = _crown(Block.JUNGLE_LEAVES, [(height + 1, 2), (height, 3.2), (height - 1, 3.6)], 2)
    vines = {(x, y, z): Block.VINES for x, z in ((-1, 0), (2, 1), (1, -1)) for y in range(1, height - 1)}
    return _shape(_pole(Block.JUNGLE_WOOD, height, 2), {**vines, **crown})


def _swamp_oak(height: int) -> Shape:
    crown = _crown(Block.OAK_LEAVES, [(height + 1, 2.2), (height, 3.2), (height - 1, 3.2)])
    vines = {(x, y, z): Block.VINES for x, z in ((3, 0), (-3, 1), (0, 3), (1, -3)) for y in range(2, height - 1)}
    return _shape(_pole(Block.OAK_WOOD, height + 1), {**vines, **crown})


def _acacia(height: int, lean: int) -> Shape:
    bend = height - 2
    trunk = {(0 if y < bend else (y - bend + 1) * lean, y, 0): Block.ACACIA_WOOD for y in range(height)}
    crown = _crown(Block.ACACIA_LEAVES, [(height, 2.6), (height + 1, 1)])
    return _shape(trunk, {(x + 2 * lean, y, z): block for (x, y, z), block in crown.items()})


def _bush(height: int) -> Shape:
    return _shape({(0, 0, 0): Block.JUNGLE_WOOD}, _crown(Block.OAK_LEAVES, [(0, 1.2), (height, 1)]))


def _mushroom(height: int) -> Shape:
    return _shape(_pole(Block.MUSHROOM_BLOCK, height), _crown(Block.MUSHROOM_BLOCK, [(height, 2.2), (height - 1, 3.0)]))


def _ice_spike(height: int, radius: float) -> Shape:
    layers = [(y, radius * (height - y) / height) for y in range(height)]
    return _shape(_crown(Block.PACKED_ICE, layers))


def _boulder() -> Shape:
    return _shape(_crown(Block.MOSS_STONE, [(0, 1.2), (1, 1)]))


def _single(block: Block) -> Callable[[int], Shape]:
    return lambda height: _shape(_pole(block, height))


def _heights(make: Callable[[int], Shape], *heights: int) -> list[Shape]:
    return [make(height) for height in heights]


_OAK = _heights(lambda h: _round_tree(Block.OAK_WOOD, Block.OAK_LEAVES, h), 4, 5, 6)
_BIRCH = _heights(lambda h: _round_tree(Block.BIRCH_WOOD, Block.BIRCH_LEAVES, h), 5, 6, 7)
_SPRUCES = _heights(_spruce, 6, 7, 8, 9)
_JUNGLE = _heights(_jungle_tree, 6, 7, 8, 9)
_SPIKES = [_ice_spike(7, 1.4), _ice_spike(10, 1.8), _ice_spike(13, 2.2), _ice_spike(20, 2.6)]

TREES: Mapping[Biome, tuple[float, list[Shape]]] = {
    # The share of a biome's ground columns that have a tree, and the kinds of trees, about equally frequent.
    Biome.PLAINS: (0.0006, _OAK),
    Biome.FOREST: (0.016, [*_OAK, *_OAK, *_BIRCH[:2]]),
    Biome.BIRCH_FOREST: (0.016, _BIRCH),
    Biome.ROOFED_FOREST: (0.018, [*_heights(_dark_oak, 6, 7, 6, 7, 6, 7), _OAK[1], _mushroom(5)]),
    Biome.TAIGA: (0.016, [*_SPRUCES * 3, _boulder()]),
    Biome.COLD_TAIGA: (0.016, _SPRUCES),
    Biome.JUNGLE: (0.026, [*_JUNGLE, *_JUNGLE, *_heights(_great_jungle_tree, 15, 19), *_heights(_bush, 1, 1, 1, 1)]),
    Biome.SAVANNA: (0.0035, [_acacia(5, 1), _acacia(6, -1), _acacia(6, 1), _acacia(7, -1)]),
    Biome.SWAMPLAND: (0.006, _heights(_swamp_oak, 5, 6)),
    Biome.DESERT: (0.003, _heights(_single(Block.CACTUS), 1, 2, 3)),
    Biome.EXTREME_HILLS: (0.002, [_SPRUCES[1], _OAK[0]]),
    Biome.ICE_PLAINS: (0.0006, _SPRUCES[:2]),
    Biome.ICE_SPIKES: (0.008, _SPIKES),
    Biome.MUSHROOM_ISLAND: (0.003, _heights(_mushroom, 5, 6)),
}

_CHOICES = 256
"""A plant is chosen by 8 bits of its column's hash."""

SHAPES: list[Shape] = []
TREE_DENSITY = np.zeros(256, np.float32)
TREE_CHOICE = np.zeros((256, _CHOICES), np.int32)
SHRUB_DENSITY = np.zeros(256, np.float32)
SHRUB_CHOICE = np.zeros((256, _CHOICES), np.uint8)
for _biome, (_density, _shapes) in TREES.items():
    TREE_DENSITY[_biome] = _density
    TREE_CHOICE[_biome] = len(SHAPES) + np.arange(_CHOICES) % len(_shapes)
    SHAPES += _shapes
for _biome, _facts in BIOMES.items():
    if _shrubs := [Block[name] for name, count in _facts.get("shrubs", {}).items() for _ in range(count)]:
        SHRUB_DENSITY[_biome] = _facts["shrub_density"]
        SHRUB_CHOICE[_biome] = np.resize(_shrubs, _CHOICES)


class PlantPart:
    """A part (the trunk or the foliage) of all shapes in one table, so that many plants are placed at once."""

    def __init__(self, tables: Sequence[NDArray[np.int32]]) -> None:
        self._count = np.array([len(table) for table in tables])
        self._first = np.cumsum(self._count) - self._count
        self._cells = np.concatenate(tables).T.copy()
        self._blocks = self._cells[3].astype(np.uint8)

    def place(
        self, kinds: NDArray[np.int32], feet: NDArray[np.int32], size: tuple[int, ...]
    ) -> tuple[NDArray[np.int32], NDArray[np.uint8]]:
        """Flat positions and blocks, plant by plant, of the cells that lie in a box of that size.

        `kinds` are indices of `SHAPES`; `feet` has a row for each of x, y, z.
        """
        count = self._count[kinds]
        row = np.arange(count.sum()) + (self._first[kinds] - np.cumsum(count) + count).repeat(count)
        x, y, z = (foot.repeat(count) + cell.take(row) for foot, cell in zip(feet, self._cells[:3], strict=True))
        inside = (x >= 0) & (x < size[0]) & (z >= 0) & (z < size[1]) & (y < size[2])
        return ((x * size[1] + z) * size[2] + y)[inside], self._blocks[row[inside]]


TRUNKS = PlantPart([shape.trunk for shape in SHAPES])
FOLIAGE = PlantPart([shape.foliage for shape in SHAPES])

_LEAVES = [b for b in Block if b.name.endswith("LEAVES")]
GIVES_WAY = np.array([b in _LEAVES or (not SOLID[b] and b != Block.WATER) for b in Block])
"""By block: whether a trunk grows through it."""
