"""The turns of creatures, arrows and plants in a compiled world, and the balance of creatures.

The rules and the order of all draws are those of `creatures` and `balance`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from smartplay_tools.games.crafter.balance import COWS, SKELETONS, ZOMBIES
from smartplay_tools.games.crafter.compiled.body import hurt
from smartplay_tools.games.crafter.compiled.ground import (
    add,
    distance,
    is_creature,
    remove,
    set_ground,
    thing_at,
    toward,
    walk,
)
from smartplay_tools.games.crafter.compiled.jit import inlined, kernel
from smartplay_tools.games.crafter.compiled.layout import id_table
from smartplay_tools.games.crafter.compiled.twister import below, draw_word, uniform
from smartplay_tools.games.crafter.facts import (
    AREA,
    ARROW,
    CHUNK,
    CHUNKS,
    COW,
    FURNACE,
    PATH,
    PLAYER,
    SKELETON,
    TABLE,
    WALKABLE,
    WALKABLE_FOR_ARROW,
    ZOMBIE,
)
from smartplay_tools.games.crafter.world import CHUNK_OF, COLUMN, DIRECTIONS, MARGIN

_FREE, _FREE_FOR_ARROW = id_table(WALKABLE), id_table(WALKABLE_FOR_ARROW)
_DIRECTIONS = np.array(DIRECTIONS, np.int64)
_CHUNK_OF = np.frombuffer(CHUNK_OF, np.uint8).copy()
_THREE = np.uint32(3)


@kernel
def _wander(world: Any, thing: Any) -> None:
    walk(world, thing, _DIRECTIONS[draw_word(world) & _THREE], _FREE)


@kernel
def _cow(world: Any, thing: Any) -> None:
    if thing.health == 0:
        remove(world, thing)
    if uniform(world) < 0.5:
        _wander(world, thing)


@kernel
def _zombie(world: Any, thing: Any) -> None:
    if thing.health == 0:
        remove(world, thing)
    if distance(thing.at, world.at) <= 8 and uniform(world) < 0.9:
        longer = uniform(world) < 0.8
        walk(world, thing, toward(thing.at, world.at, longer), _FREE)
    else:
        _wander(world, thing)
    if distance(thing.at, world.at) <= 1:
        if thing.clock:
            thing.clock -= 1
        else:
            hurt(world, 7 if world.sleeping else 2)
            thing.clock = 5


@kernel
def _skeleton(world: Any, things: Any, near: Any, thing: Any) -> None:
    if thing.health == 0:
        remove(world, thing)
    thing.clock = max(0, thing.clock - 1)
    away = distance(thing.at, world.at)
    if away <= 3:
        longer = uniform(world) < 0.6
        if walk(world, thing, -toward(thing.at, world.at, longer), _FREE):
            return
    if away <= 5 and uniform(world) < 0.5:
        direction = toward(thing.at, world.at, True)
        target = thing.at + direction
        if not thing.clock and direction and _FREE_FOR_ARROW[world.surface[target]]:
            add(world, things, near, ARROW, target, direction)
            thing.clock = 4
    elif away <= 8 and uniform(world) < 0.3:
        longer = uniform(world) < 0.6
        walk(world, thing, toward(thing.at, world.at, longer), _FREE)
    elif uniform(world) < 0.2:
        _wander(world, thing)


@kernel
def _arrow(world: Any, things: Any, near: Any, thing: Any) -> None:
    target = thing.at + thing.heading
    hit = world.surface[target]
    if walk(world, thing, thing.heading, _FREE_FOR_ARROW):
        return
    if hit == PLAYER:
        hurt(world, 2)
    elif hit > PLAYER:
        other = things[thing_at(world, things, near, target)]
        other.health = max(0, np.int64(other.health) - 2)
    remove(world, thing)
    if hit in (TABLE, FURNACE):
        set_ground(world, target, PATH)


@kernel
def _plant(world: Any, thing: Any) -> None:
    thing.clock += 1
    for direction in _DIRECTIONS:
        if is_creature(world.surface[thing.at + direction]):
            thing.health = 0
    if thing.health == 0:
        remove(world, thing)


@inlined
def take_thing_turn(world: Any, things: Any, near: Any, thing: Any) -> None:
    """The turn of a thing."""
    if thing.kind == COW:
        _cow(world, thing)
    elif thing.kind == ZOMBIE:
        _zombie(world, thing)
    elif thing.kind == SKELETON:
        _skeleton(world, things, near, thing)
    elif thing.kind == ARROW:
        _arrow(world, things, near, thing)
    else:
        _plant(world, thing)


# --- How many there are ----------------------------------------------------------------------------------------------


@kernel
def _nth_cell(world: Any, chunk: int, material: int, n: int) -> int:
    """The n-th cell of a material in a chunk, column by column."""
    x, y = chunk // CHUNKS * CHUNK, chunk % CHUNKS * CHUNK
    for column in range(x, min(x + CHUNK, AREA)):
        for row in range(y, min(y + CHUNK, AREA)):
            cell = (column + MARGIN) * COLUMN + row + MARGIN
            if world.ground[cell] == material:
                if n == 0:
                    return cell
                n -= 1
    return -1


@kernel
def _nth_thing(world: Any, things: Any, chunk: int, kind: int, n: int) -> int:
    """The number of the n-th thing of a kind in a chunk, in the order of arrival."""
    last = -1
    while True:
        earliest = -1
        for i in range(world.thing_count):
            thing = things[i]
            if thing.kind != kind or thing.removed or _CHUNK_OF[thing.at] != chunk or thing.entered <= last:
                continue
            if earliest < 0 or thing.entered < things[earliest].entered:
                earliest = i
        if n == 0:
            return earliest
        last = things[earliest].entered
        n -= 1


@kernel
def _come_or_leave(
    world: Any, things: Any, near: Any, chunk: int, cells: int, least: int, most: int, rule: Any
) -> None:
    kind, material, space, least_distance, leave_distance, come, leave = rule
    count = world.counts[kind, chunk]
    if count < least and cells >= space:
        if uniform(world) < come:
            where = _nth_cell(world, chunk, material, below(world, cells))
            if world.surface[where] < PLAYER and distance(where, world.at) >= least_distance:
                add(world, things, near, kind, where, 0)
    elif count > most and uniform(world) < leave:
        thing = things[_nth_thing(world, things, chunk, kind, below(world, count))]
        if distance(thing.at, world.at) >= leave_distance:
            remove(world, thing)


_ZOMBIES, _SKELETONS, _COWS = tuple(ZOMBIES), tuple(SKELETONS), tuple(COWS)


@inlined
def balance(world: Any, things: Any, near: Any, now: Any) -> None:
    """Add and remove creatures in every chunk that something has been in."""
    for i in range(world.chunk_count):
        chunk = world.visits[i]
        grass = world.grass[chunk]
        _come_or_leave(world, things, near, chunk, grass, now.zombies, now.zombies, _ZOMBIES)
        _come_or_leave(world, things, near, chunk, world.paths[chunk], 1, 2, _SKELETONS)
        _come_or_leave(world, things, near, chunk, grass, 1, now.cows, _COWS)
