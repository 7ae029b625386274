"""Animals: small herds that graze and wander, seen by the rays as entities.

An animal's place is a function of seed, home and time, so nothing has to be simulated or stored, and it does not depend
on what the player does. Animals do not block the player.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from smartplay_tools.games.minecraft.voxel.climate import BIOMES, SEA_LEVEL, TABLE
from smartplay_tools.games.minecraft.voxel.noise import hashed, unit
from smartplay_tools.games.minecraft.voxel.world import BOTTOM, SIDE, VoxelWorld


@dataclass(frozen=True)
class Species:
    """A kind of animal: the game's name of its class in lower case, and the size of its box."""

    name: str
    width: float
    height: float
    swims: bool = False


SPECIES = {name: Species(name, **size) for name, size in TABLE["animals"].items()}
"""Every kind by its name."""
NAMES = np.array(["null", *SPECIES])
"""Entity names: "null" for no entity, then the species in their order."""

_CHOICES = 8
_SPECIES_OF = np.full((256, _CHOICES), -1)
for _biome, _facts in BIOMES.items():
    if _lives := [[*SPECIES].index(name) for name in _facts.get("animals", ())]:
        _SPECIES_OF[_biome] = np.resize(_lives, _CHOICES)
_WIDTH, _HEIGHT = (np.array([getattr(s, name) for s in SPECIES.values()]) for name in ("width", "height"))
_SWIMS = np.array([s.swims for s in SPECIES.values()])

FARTHEST = 64
"""Only animals whose home is this near, along x and z, are computed: they are inside the generated part."""

_PASTURE = 40
"""Side of the squares of land of which some have a herd."""
_HERDS = 0.7
_HERD = 4
_ROAM = 6
"""Blocks between a herd's middle and an animal's home."""
_STROLL = 3
"""The farthest that an animal walks from home, in blocks along x and z."""
_REST = 160
"""Ticks from one target of an animal's walk to the next."""
_SALT = 201


def animals_near(
    world: VoxelWorld, x: int, z: int, time: int
) -> tuple[NDArray[np.intp], NDArray[np.float32], NDArray[np.float32]]:
    """Species (as an index of `SPECIES`) and the two corners of the box of every animal around a place."""
    squares = x // _PASTURE, z // _PASTURE
    number, ticks = divmod(time, _REST)
    herds = _herds(world.seed, *squares)
    # They walk from place to place, and rest half of the time.
    here, there = (_stops(world.seed, *squares, n) for n in (number, number + 1))
    at = herds.home + (here + (there - here) * min(2 * ticks / _REST, 1.0))
    home_x, home_z = herds.home & (SIDE - 1)
    under_x, under_z = np.floor(at).astype(np.int64) & (SIDE - 1)
    species = _SPECIES_OF[world.biome[home_x, home_z], herds.choice]
    ground = world.ground[under_x, under_z].astype(np.int64) + BOTTOM
    swims = _SWIMS[species]
    lives = (species >= 0) & np.where(swims, ground < SEA_LEVEL - 4, ground >= SEA_LEVEL - 1)
    lives &= (np.abs(herds.home - np.array([[x], [z]])) <= FARTHEST).all(axis=0)
    feet = np.where(swims, SEA_LEVEL - 2, ground + 1)
    species, feet, at = species[lives], feet[lives], at[:, lives]
    half = _WIDTH[species] / 2
    low, high = at - half, at + half
    corners = np.array([[low[0], feet, low[1]], [high[0], feet + _HEIGHT[species], high[1]]], np.float32)
    return species, corners[0].T, corners[1].T


@dataclass(frozen=True)
class _Herds:
    """The animals that may live in the pastures around one, whatever the ground is."""

    number: NDArray[np.int64]
    """What tells an animal from the others of its row of pastures, by animal."""
    row: NDArray[np.int64]
    home: NDArray[np.int64]
    """x and z of the homes, [axis, animal]."""
    choice: NDArray[np.uint32]
    """Which of the species of its biome it is."""


@functools.lru_cache(maxsize=64)
def _herds(seed: int, x: int, z: int) -> _Herds:
    span = np.arange(-2, 3)
    grid = np.meshgrid(x + span, z + span, np.arange(_HERD), indexing="ij")
    i, j, member = (axis.ravel() for axis in grid)
    number = i * _HERD + member
    herd, own = hashed(seed, _SALT, i, j), hashed(seed, _SALT + 1, number, j)
    # Different bits of one hash are independent random numbers.
    home_x = i * _PASTURE + _roll(herd, 4, _PASTURE) + _roll(own, 0, 2 * _ROAM + 1) - _ROAM
    home_z = j * _PASTURE + _roll(herd, 12, _PASTURE) + _roll(own, 8, 2 * _ROAM + 1) - _ROAM
    some = (unit(herd) < _HERDS) & (member <= _roll(herd, 2, _HERD))
    return _Herds(number[some], j[some], np.stack([home_x, home_z])[:, some], herd[some] % _CHOICES)


@functools.lru_cache(maxsize=64)
def _stops(seed: int, x: int, z: int, number: int) -> NDArray[np.float64]:
    """Where the animals rest before their walk with that number, from their homes, [axis, animal]."""
    herds = _herds(seed, x, z)
    salts = (_SALT + 10 + 2 * number + axis for axis in (0, 1))
    bits = np.stack([hashed(seed, salt, herds.number, herds.row) for salt in salts])
    stops: NDArray[np.float64] = (unit(bits) * 2 - 1).astype(np.float64) * _STROLL + 0.5
    return stops


def _roll(bits: NDArray[np.uint32], shift: int, sides: int) -> NDArray[np.int64]:
    return (bits >> np.uint32(shift)).astype(np.int64) % sides
