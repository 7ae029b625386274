"""Climate: from a seed to biomes and ground heights.

Biomes and heights follow from six smooth fields. These are computed every 8 blocks and interpolated, so a search over
kilometres sees exactly what the ground will have at its points. Heights are continuous across the borders of biomes,
so no border is too steep to cross.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smartplay_tools.games.minecraft.voxel.noise import Axis, Field, Fractal, Noise, enlarge
from smartplay_tools.types.tables import read_table

SEA_LEVEL = 63
"""The first layer of air above the sea; the highest water is one below."""

LOWEST_GROUND, HIGHEST_GROUND = 38, 106

_FLAT = 0.0008
"""The least slope of the rivers' field that is used: with a smaller one, rivers would become lakes."""

SPACING = 8
"""Blocks between two points of the slow fields."""


class Biome(IntEnum):
    """The biomes of this world, with Minecraft's ids."""

    OCEAN = 0
    PLAINS = 1
    DESERT = 2
    EXTREME_HILLS = 3
    FOREST = 4
    TAIGA = 5
    SWAMPLAND = 6
    RIVER = 7
    FROZEN_OCEAN = 10
    FROZEN_RIVER = 11
    ICE_PLAINS = 12
    MUSHROOM_ISLAND = 14
    BEACH = 16
    JUNGLE = 21
    DEEP_OCEAN = 24
    STONE_BEACH = 25
    COLD_BEACH = 26
    BIRCH_FOREST = 27
    ROOFED_FOREST = 29
    COLD_TAIGA = 30
    SAVANNA = 35
    ICE_SPIKES = 140


TABLE = read_table(__package__, "biomes.toml")
BIOMES: Mapping[Biome, Mapping[str, Any]] = {Biome[name]: facts for name, facts in TABLE["biomes"].items()}
"""What the table says of the biomes."""


@dataclass(frozen=True)
class Climate:
    """The slow fields, [x, z], each in about [-1, 1]."""

    land: Field
    """Above 0 is land; `SHORE` and more is inland."""
    warmth: Field
    wetness: Field
    variety: Field
    """Chooses between biomes of the same warmth and wetness."""
    ruggedness: Field
    river: Field
    """Blocks to the middle of the nearest river, about; of either sign on its two sides."""

    @cached_property
    def swampiness(self) -> Field:
        """1 in the middle of a swamp, falling to 0 around it."""
        mild = _ramp(self.warmth, COOL, 14) * _ramp(-self.warmth, -0.4, 14)
        return _ramp(self.wetness, 0.1, 14) * _ramp(self.variety, -0.08, 14) * mild * _ramp(-self.ruggedness, -0.2, 10)

    @cached_property
    def islandness(self) -> Field:
        """1 in the middle of a mushroom island, falling to 0 around it."""
        return _ramp(self.variety, 0.3, 8) * _ramp(-self.land, 0.14, 14)


SHORE = 0.03
COLD, COOL, WARM = -0.26, -0.08, 0.16
RUGGED = 0.4
RIVER_BED, RIVER_BANK = 5.0, 24.0
"""Blocks from the middle of a river to where its bed ends, and to where its valley does."""


_FIELDS = Noise(
    Fractal(salt=1, scale=760, octaves=4),  # land
    Fractal(salt=2, scale=640, octaves=3),  # warmth
    Fractal(salt=3, scale=520, octaves=3),  # wetness
    Fractal(salt=4, scale=340, octaves=2),  # variety
    Fractal(salt=5, scale=480, octaves=2),  # ruggedness
    # Rivers run where a field is 0; its slope, from two neighbours, turns the field's value into a distance.
    Fractal(salt=6, scale=800, octaves=3),
    Fractal(salt=6, scale=800, octaves=3, east=SPACING),
    Fractal(salt=6, scale=800, octaves=3, south=SPACING),
)
_HILLS = Noise(Fractal(salt=7, scale=96, octaves=3))


def climate(seed: int, x: Axis, z: Axis) -> Climate:
    """The slow fields at the given places."""
    land, warmth, wetness, variety, ruggedness, course, east, south = _FIELDS(seed, x, z)
    slopes = [(there - course) / np.float32(SPACING) for there in (east, south)]
    slope = np.sqrt(slopes[0] ** 2 + slopes[1] ** 2)
    river = (course / np.maximum(slope, np.float32(_FLAT))).astype(np.float32, copy=False)
    return Climate(land + np.float32(0.3), warmth, wetness, variety, ruggedness, river)


def biomes(c: Climate) -> NDArray[np.uint8]:
    """The biome of every place. Later rules win."""
    biome = np.full_like(c.land, Biome.PLAINS, np.uint8)
    biome[c.wetness > -0.02] = Biome.FOREST
    biome[(c.wetness > -0.02) & (c.variety > 0.22)] = Biome.BIRCH_FOREST
    biome[(c.wetness > 0.06) & (c.variety < -0.22)] = Biome.ROOFED_FOREST
    warm = c.warmth > WARM
    biome[warm] = Biome.SAVANNA
    biome[warm & (c.wetness < -0.06)] = Biome.DESERT
    biome[warm & (c.wetness > 0.06)] = Biome.JUNGLE
    cool = c.warmth < COOL
    biome[cool & (c.wetness > -0.14)] = Biome.TAIGA
    cold = c.warmth < COLD
    biome[cold] = Biome.ICE_PLAINS
    biome[cold & (c.variety > 0.02)] = Biome.ICE_SPIKES
    biome[cold & (c.wetness > 0.1)] = Biome.COLD_TAIGA
    biome[c.swampiness > 0.5] = Biome.SWAMPLAND
    biome[(c.ruggedness > RUGGED) & (c.land > SHORE)] = Biome.EXTREME_HILLS
    river = np.abs(c.river) < RIVER_BED + 3
    biome[river] = Biome.RIVER
    biome[river & cold] = Biome.FROZEN_RIVER
    shore = c.land < SHORE
    biome[shore] = Biome.BEACH
    biome[shore & cold] = Biome.COLD_BEACH
    biome[shore & (c.ruggedness > RUGGED)] = Biome.STONE_BEACH
    ocean = c.land < 0
    biome[ocean] = Biome.OCEAN
    biome[c.land < -0.25] = Biome.DEEP_OCEAN
    biome[ocean & cold] = Biome.FROZEN_OCEAN
    biome[c.islandness > 0.6] = Biome.MUSHROOM_ISLAND
    return biome


def heights(seed: int, c: Climate, x: Axis, z: Axis) -> NDArray[np.int16]:
    """The highest block of the ground, plants left out."""
    hills = _HILLS(seed, x, z)[0]
    rise = _ramp(c.land, SHORE, 1 / 12)
    mountain = np.maximum(c.ruggedness - np.float32(RUGGED - 0.1), 0) * rise
    height = np.where(
        c.land < SHORE,
        np.float32(61.4) + 60 * c.land + np.minimum(np.maximum(-5 * c.land, 0), 1) * 3 * hills,
        np.float32(63.2) + rise * (3 + 4 * np.maximum(hills, -0.7)) + mountain * (70 + 60 * hills),
    )
    swamp = c.swampiness * rise
    height += swamp * (np.float32(62.1) + np.float32(1.6) * hills - height)
    inland = c.land >= SHORE
    valley = 1 - _ramp(np.abs(c.river), RIVER_BED, 1 / (RIVER_BANK - RIVER_BED))
    height += np.where(inland, valley * rise, 0) * (np.float32(58.5) - height)
    height += c.islandness * (np.float32(66) + 3 * hills - height)
    ground: NDArray[np.int16] = np.clip(np.floor(height), LOWEST_GROUND, HIGHEST_GROUND).astype(np.int16)
    return ground


def _ramp(field: Field, start: float, slope: float) -> Field:
    """0 up to `start`, then rising by `slope` per unit to 1."""
    ramp: Field = field - np.float32(start)
    ramp *= np.float32(slope)
    return ramp.clip(0, 1, out=ramp)


def terrain(seed: int, x: Axis, z: Axis) -> tuple[NDArray[np.uint8], NDArray[np.int16]]:
    """Biome and ground height of every block column of a rectangle."""
    corners_x = np.arange(x[0, 0] // SPACING, x[-1, 0] // SPACING + 2)[:, None] * SPACING
    corners_z = np.arange(z[0, 0] // SPACING, z[0, -1] // SPACING + 2)[None, :] * SPACING
    coarse = np.stack(list(vars(climate(seed, corners_x, corners_z)).values()))
    fine = Climate(*enlarge(coarse, x, z, SPACING))
    return np.ascontiguousarray(biomes(fine)), np.ascontiguousarray(heights(seed, fine, x, z))
