"""The map of a compiled world: what stands where, and what each chunk counts. The same as `world.World`, compiled."""

from __future__ import annotations

from typing import Any

import numpy as np

from smartplay_tools.games.crafter.compiled.jit import kernel
from smartplay_tools.games.crafter.facts import COW, GRASS, HEALTH, NAMES, PATH, PLAYER, SKELETON, ZOMBIE
from smartplay_tools.games.crafter.world import CHUNK_OF, COLUMN, NEAR

_CHUNK_OF = np.frombuffer(CHUNK_OF, np.uint8).copy()
_HEALTH = np.array([HEALTH.get(kind, 0) for kind in range(len(NAMES))], np.uint8)
_COLUMN_BITS = COLUMN.bit_length() - 1
_ROW = COLUMN - 1


@kernel
def distance(one: int, other: int) -> int:
    """How many steps one place lies from another."""
    across = (one >> _COLUMN_BITS) - (other >> _COLUMN_BITS)
    return abs(across) + abs((one & _ROW) - (other & _ROW))


@kernel
def toward(here: int, there: int, longer: bool) -> int:
    """The step from here to there along the axis with the longer, or the shorter, way to go; 0 if it has none."""
    across = (there >> _COLUMN_BITS) - (here >> _COLUMN_BITS)
    down = (there & _ROW) - (here & _ROW)
    if (abs(across) > abs(down)) == longer:
        return COLUMN * ((across > 0) - (across < 0))
    return (down > 0) - (down < 0)


@kernel
def visit(world: Any, at: int) -> int:
    """The chunk of a place, which begins to exist when something enters it."""
    chunk = _CHUNK_OF[at]
    if not world.visited[chunk]:
        world.visited[chunk] = 1
        world.visits[world.chunk_count] = chunk
        world.chunk_count += 1
    return chunk


@kernel
def enter(world: Any, thing: Any) -> None:
    """Count a thing in the chunk where it stands, as the last that came."""
    chunk = visit(world, thing.at)
    world.counts[thing.kind, chunk] += 1
    thing.entered = world.entries
    world.entries += 1


@kernel
def add(world: Any, things: Any, near: Any, kind: int, at: int, heading: int) -> None:
    """Put a thing on the map. There has to be room for it in `things`."""
    thing = things[world.thing_count]
    thing.kind = kind
    thing.at = at
    thing.health = _HEALTH[kind]
    thing.clock = 0
    thing.heading = heading
    thing.removed = 0
    world.surface[at] = kind
    near[world.near_count] = world.thing_count
    world.near_count += 1
    world.thing_count += 1
    enter(world, thing)


@kernel
def remove(world: Any, thing: Any) -> None:
    """Take a thing off the map."""
    if thing.removed:
        return
    thing.removed = 1
    world.surface[thing.at] = world.ground[thing.at]
    world.counts[thing.kind, _CHUNK_OF[thing.at]] -= 1


@kernel
def walk(world: Any, thing: Any, direction: int, free: Any) -> bool:
    """Move a thing if the next cell is free for it; one that has been removed stays away. Returns whether it is."""
    target = thing.at + direction
    if not free[world.surface[target]]:
        return False
    if not thing.removed:
        here = thing.at
        world.surface[here] = world.ground[here]
        world.surface[target] = thing.kind
        thing.at = target
        if _CHUNK_OF[here] != _CHUNK_OF[target]:
            world.counts[thing.kind, _CHUNK_OF[here]] -= 1
            enter(world, thing)
    return True


@kernel
def set_ground(world: Any, at: int, material: int) -> None:
    """Change the material of a cell."""
    old = world.ground[at]
    world.ground[at] = material
    if world.surface[at] < PLAYER:
        world.surface[at] = material
    chunk = _CHUNK_OF[at]
    world.grass[chunk] += (material == GRASS) - (old == GRASS)
    world.paths[chunk] += (material == PATH) - (old == PATH)


@kernel
def thing_at(world: Any, things: Any, near: Any, at: int) -> int:
    """The number of the thing that stands on a place near the player where the surface shows one."""
    for i in range(world.near_count):
        thing = things[near[i]]
        if thing.at == at and not thing.removed:
            return near[i]
    return -1


@kernel
def list_near(world: Any, things: Any, near: Any) -> None:
    """Drop the things that were removed, and list those that may have a turn in the next steps."""
    kept, close = 0, 0
    for i in range(world.thing_count):
        if things[i].removed:
            continue
        if kept != i:
            things[kept] = things[i]
        if distance(things[kept].at, world.at) < NEAR:
            near[close] = kept
            close += 1
        kept += 1
    world.thing_count = kept
    world.near_count = close


@kernel
def is_creature(kind: int) -> bool:
    """Whether a thing of this kind eats plants and can be struck."""
    return kind in (COW, ZOMBIE, SKELETON)
