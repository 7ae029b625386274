"""A window of blocks that follows the player.

The window is a torus: a cell's place in it is its coordinate modulo the window's side, so nothing moves when the
player does. Chunks are made when they come near and overwrite those that are far away.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smartplay_tools.games.minecraft.voxel import plants
from smartplay_tools.games.minecraft.voxel.blocks import Block
from smartplay_tools.games.minecraft.voxel.climate import BIOMES, SEA_LEVEL, Biome, terrain
from smartplay_tools.games.minecraft.voxel.noise import hashed, unit

SIDE = 256
"""Side of the window, a power of two."""

BOTTOM, HEIGHT = 32, 96
"""The window's lowest layer and its number of layers. Nothing outside is ever seen."""

CHUNK = 32
"""Side of what is generated at once. Few large calls of NumPy cost less than many small ones."""

NEAREST = 72
"""Everything up to this distance from the player, along x and z, is generated before it is used."""

_MASK = SIDE - 1


def _profiles() -> NDArray[np.uint8]:
    """Precomputed columns by (surface, ground height over the bottom)."""
    columns = np.zeros((len(_SURFACES), HEIGHT, HEIGHT), np.uint8)
    water = SEA_LEVEL - BOTTOM
    for surface, (top, under, bed, frozen) in enumerate(_SURFACES):
        for ground in range(HEIGHT):
            column = columns[surface, ground]
            column[:ground] = Block.STONE
            column[max(ground - 3, 0) : ground] = under
            column[ground] = top if ground >= water - 1 else bed
            if ground + BOTTOM > 88 and top == Block.GRASS_BLOCK:
                column[max(ground - 3, 0) : ground + 1] = Block.STONE
            if ground + BOTTOM > 97:
                column[ground] = Block.SNOW_BLOCK
            column[ground + 1 : water] = Block.WATER
            if frozen and ground < water - 1:
                column[water - 1] = Block.ICE
            column[0] = Block.BEDROCK
    return columns


def _surface(facts: Mapping[str, Any]) -> tuple[Block, Block, Block, bool]:
    """The top block, the block under it, the bed of water, and whether water freezes, by what is known of a biome."""
    top, under, bed = (Block[name] for name in facts.get("ground", ("GRASS_BLOCK", "DIRT", "DIRT")))
    return top, under, bed, "freezes" in facts


_SURFACES = [*dict.fromkeys([_surface({}), *map(_surface, BIOMES.values())])]
_SURFACE = np.zeros(256, np.intp)
for _biome, _facts in BIOMES.items():
    _SURFACE[_biome] = _SURFACES.index(_surface(_facts))
_PROFILES = _profiles()
_COVER = np.zeros(256, np.uint8)
"""By biome: what lies where no plant stands."""
_COVER[[Biome.ICE_PLAINS, Biome.COLD_TAIGA, Biome.COLD_BEACH, Biome.FROZEN_RIVER]] = Block.SNOW

_TREE_SALT, _SHRUB_SALT = 101, 102


class VoxelWorld:
    """The blocks around one player.

    Attributes:
        blocks: the window, [x, z, y].
        flat: the same bytes in a row, for reading single cells.
        biome: biome id by [x, z].
        ground: the highest block of the ground by [x, z], in the window's layers.
    """

    def __init__(self, seed: int) -> None:
        self.seed = seed
        self.blocks = np.zeros((SIDE, SIDE, HEIGHT), np.uint8)
        self.flat = memoryview(self.blocks.data).cast("B")
        self.biome = np.zeros((SIDE, SIDE), np.uint8)
        self.ground = np.zeros((SIDE, SIDE), np.int16)
        self._present: dict[tuple[int, int], tuple[int, int]] = {}
        self._prepared: tuple[int, ...] = ()

    def __getstate__(self) -> dict[str, Any]:
        """The state without the second view of the blocks, which a copy makes from its own blocks."""
        return {name: value for name, value in vars(self).items() if name != "flat"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self.flat = memoryview(self.blocks.data).cast("B")

    def prepare(self, x: int, z: int) -> None:
        """Generate the missing chunks around a place."""
        near = tuple((c + side) // CHUNK for c in (x, z) for side in (-NEAREST, NEAREST))
        if near == self._prepared:
            return
        self._prepared = near
        west, east, north, south = near
        slots = SIDE // CHUNK - 1
        missing = {
            (i, j)
            for i in range(west, east + 1)
            for j in range(north, south + 1)
            if self._present.get((i & slots, j & slots)) != (i, j)
        }
        for i, j in missing:
            self._present[i & slots, j & slots] = (i, j)
        for i, j, wide, deep in _rectangles(missing):
            self._generate(i * CHUNK, j * CHUNK, wide * CHUNK, deep * CHUNK)

    def biome_at(self, x: int, z: int) -> int:
        """The biome of a column."""
        return int(self.biome[x & _MASK, z & _MASK])

    def cube(self, x: int, y: int, z: int, radius: int) -> NDArray[np.uint8]:
        """The blocks around a cell, [x, y, z]."""
        xs = np.arange(x - radius, x + radius + 1) & _MASK
        zs = np.arange(z - radius, z + radius + 1) & _MASK
        ys = np.clip(np.arange(y - radius, y + radius + 1) - BOTTOM, 0, HEIGHT - 1)
        cube: NDArray[np.uint8] = self.blocks[xs[:, None, None], zs[None, None, :], ys[None, :, None]]
        return cube

    def _generate(self, x: int, z: int, wide: int, deep: int) -> None:
        reach = plants.REACH
        xs = np.arange(x - reach, x + wide + reach)[:, None]
        zs = np.arange(z - reach, z + deep + reach)[None, :]
        biome, ground = terrain(self.seed, xs, zs)
        ground -= BOTTOM
        inner = (slice(reach, -reach), slice(reach, -reach))
        columns = _PROFILES[_SURFACE[biome[inner]], ground[inner]]
        _plant_trees(columns, biome, ground, hashed(self.seed, _TREE_SALT, xs, zs))
        shrubs = hashed(self.seed, _SHRUB_SALT, xs[reach:-reach], zs[:, reach:-reach])
        _plant_shrubs(columns, biome[inner], ground[inner], shrubs)
        i, j = (np.arange(x, x + wide) & _MASK)[:, None], (np.arange(z, z + deep) & _MASK)[None, :]
        self.blocks[i, j], self.biome[i, j], self.ground[i, j] = columns, biome[inner], ground[inner]


def _rectangles(chunks: set[tuple[int, int]]) -> Iterator[tuple[int, int, int, int]]:
    """Cut a set of chunks into few rectangles (first x, first z, width, depth), each of which is generated at once."""
    left = set(chunks)
    while left:
        i, j = min(left)
        deep = 1
        while (i, j + deep) in left:
            deep += 1
        wide = 1
        while all((i + wide, j + k) in left for k in range(deep)):
            wide += 1
        left -= {(i + a, j + b) for a in range(wide) for b in range(deep)}
        yield i, j, wide, deep


def _plant_trees(
    columns: NDArray[np.uint8], biome: NDArray[np.uint8], ground: NDArray[np.int16], bits: NDArray[np.uint32]
) -> None:
    """Plant the trees of a rectangle and those around it that reach into it."""
    rooted = (unit(bits) < plants.TREE_DENSITY[biome]) & (ground >= SEA_LEVEL - 1 - BOTTOM)
    x, z = np.nonzero(rooted)
    kinds = plants.TREE_CHOICE[biome[x, z], bits[x, z] & 255]
    # Shape by shape and then by place: of two trees, the same one wins wherever the rectangle begins.
    order = kinds.argsort(kind="stable")
    x, z, kinds = x[order], z[order], kinds[order]
    feet = np.stack([x - plants.REACH, ground[x, z] + 1, z - plants.REACH]).astype(np.int32)
    flat = columns.reshape(-1)
    where, what = plants.FOLIAGE.place(kinds, feet, columns.shape)
    free = flat[where] == Block.AIR
    flat[where[free]] = what[free]
    where, what = plants.TRUNKS.place(kinds, feet, columns.shape)
    free = plants.GIVES_WAY[flat[where]]
    flat[where[free]] = what[free]


def _plant_shrubs(
    columns: NDArray[np.uint8], biome: NDArray[np.uint8], ground: NDArray[np.int16], bits: NDArray[np.uint32]
) -> None:
    """Place everything that is one cell high on free ground: snow, plants, lilies on a swamp's water."""
    flat = columns.reshape(-1)
    above = np.arange(0, flat.size, HEIGHT).reshape(biome.shape) + (ground + 1)
    dry = ground >= SEA_LEVEL - 1 - BOTTOM
    chance = unit(bits)
    shrub = np.where(chance < plants.SHRUB_DENSITY[biome], plants.SHRUB_CHOICE[biome, bits & 255], _COVER[biome])
    free = dry & (flat[above] == Block.AIR)
    flat[above[free]] = shrub[free]
    lilies = ~dry & (biome == Biome.SWAMPLAND) & (chance > np.float32(0.92))
    columns[..., SEA_LEVEL - BOTTOM][lilies] = Block.LILY_PAD
