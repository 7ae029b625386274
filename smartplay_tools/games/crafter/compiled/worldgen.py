"""The generation of a compiled world: its ground and its first things, with draws in the order of the original."""

from __future__ import annotations

from typing import Any

import numpy as np

from smartplay_tools.games.crafter.compiled.ground import add, list_near, visit
from smartplay_tools.games.crafter.compiled.jit import inlined, kernel
from smartplay_tools.games.crafter.compiled.noise import shuffle_corners
from smartplay_tools.games.crafter.compiled.terrain import IS_TUNNEL, settle, sketch
from smartplay_tools.games.crafter.compiled.twister import below, next_uniform, seed_stream, temper_all
from smartplay_tools.games.crafter.facts import (
    AREA,
    CHUNK,
    COAL,
    COW,
    DIAMOND,
    GRASS,
    IRON,
    MOST,
    PATH,
    PLAYER,
    SAND,
    SKELETON,
    TREE,
    VITALS,
    ZOMBIE,
)
from smartplay_tools.games.crafter.world import CHUNK_OF, SOUTH, place
from smartplay_tools.games.crafter.worldgen import CELLS, CENTER, FROM_CENTER

SEEDS = 2**31 - 1
"""The noise of a world has one of this many seeds."""

_PLACES = np.array([place(cell // AREA, cell % AREA) for cell in range(CELLS)])
"""The place of each cell on the maps, which have a margin."""
_CHUNK_OF = np.frombuffer(CHUNK_OF, np.uint8).copy()
_FAR_FOR_COWS, _FAR_FOR_ZOMBIES = FROM_CENTER > 3, FROM_CENTER > 10
_CENTER_PLACE = place(CENTER, CENTER)
# What is drawn for a cell, in this order; a number above the threshold ends the cell's draws.
_MATERIALS, _ABOVE_FOR_MATERIAL = (COAL, IRON, DIAMOND, TREE), (0.85, 0.75, 0.994, 0.8)
_CREATURES, _ABOVE_FOR_CREATURE = (COW, ZOMBIE, SKELETON), (0.985, 0.993, 0.95)


@kernel
def begin_terrain(world: Any, seed: int, geometry: Any, terrain: Any, slack: float) -> int:
    """Draw the seed of the world's noise, and sort the cells; return how many are unsure."""
    seed_stream(world, seed)
    shuffle_corners(below(world, SEEDS), geometry, terrain.slopes)
    return sketch(geometry, terrain, slack)


@inlined
def _draw(world: Any, words: Any, at: int, asked: int, thresholds: Any) -> tuple[int, int]:
    """Draw the numbers that are asked for, from the position `at`, until one is above its threshold.

    Returns which one, or -1, and the position after it.
    """
    for ask in range(len(thresholds)):
        if asked >> ask & 1:
            number, at = next_uniform(world.key, words, at)
            if number > thresholds[ask]:
                return ask, at
    return -1, at


@kernel
def _draw_materials(world: Any, terrain: Any, at: int) -> int:
    """Draw the numbers that materials depend on, cell by cell; return the position in the random stream."""
    materials, words = terrain.materials, terrain.words
    for cell in range(CELLS):
        ask, at = _draw(world, words, at, terrain.asks[cell], _ABOVE_FOR_MATERIAL)
        if ask >= 0:
            materials[cell] = _MATERIALS[ask]
    return at


@kernel
def _ask_for_creatures(terrain: Any) -> None:
    """Find out which numbers are drawn for the creature on each cell."""
    materials, asks = terrain.materials, terrain.asks
    for cell in range(CELLS):
        material = materials[cell]
        grass = material == GRASS
        walkable = grass | (material == PATH) | (material == SAND)
        tunnel = asks[cell] & IS_TUNNEL != 0
        asks[cell] = 1 * (grass & _FAR_FOR_COWS[cell]) + 2 * (walkable & _FAR_FOR_ZOMBIES[cell]) + 4 * tunnel


@kernel
def _lay_ground(world: Any, materials: Any) -> None:
    """Write the materials into the maps, and count grass and paths by chunk."""
    for column in range(AREA):
        first, at = column * AREA, _PLACES[column * AREA]
        for row in range(AREA):
            world.ground[at + row] = materials[first + row]
            world.surface[at + row] = materials[first + row]
        for top in range(0, AREA, CHUNK):
            grass, paths = 0, 0
            for row in range(top, min(top + CHUNK, AREA)):
                grass += materials[first + row] == GRASS
                paths += materials[first + row] == PATH
            world.grass[_CHUNK_OF[at + top]] += grass
            world.paths[_CHUNK_OF[at + top]] += paths


@kernel
def begin_world(world: Any, things: Any, near: Any, geometry: Any, start: Any, terrain: Any) -> int:
    """Draw the map and its first things; return their number. Things that do not fit into the array are left out."""
    settle(start, geometry, terrain)
    temper_all(world.key, terrain.words)
    world.word = _draw_materials(world, terrain, world.word)
    _lay_ground(world, terrain.materials)
    _begin_player(world)
    _ask_for_creatures(terrain)
    count = _draw_creatures(world, things, near, terrain)
    list_near(world, things, near)
    return count


@kernel
def _draw_creatures(world: Any, things: Any, near: Any, terrain: Any) -> int:
    """Draw the numbers that creatures depend on, cell by cell; return how many there are."""
    at, words, count = world.word, terrain.words, 0
    for cell in range(CELLS):
        ask, at = _draw(world, words, at, terrain.asks[cell], _ABOVE_FOR_CREATURE)
        if ask >= 0:
            count += 1
            if count <= len(things):
                add(world, things, near, _CREATURES[ask], _PLACES[cell], 0)
    world.word = at
    return count


@kernel
def _begin_player(world: Any) -> None:
    world.at = _CENTER_PLACE
    world.facing = SOUTH
    for vital in range(len(VITALS)):
        world.inventory[vital] = MOST
    world.last_health = MOST
    world.rewarded_health = MOST
    world.surface[_CENTER_PLACE] = PLAYER
    visit(world, _CENTER_PLACE)
