"""The turns of creatures, arrows and plants, and the balance of creatures.

The order of all draws is Crafter's. As in Crafter, a creature without health is taken off the map at the beginning of
its turn but still takes the turn: a beaten zombie may strike once more. At every tenth step each chunk may gain or lose
one creature of each kind (`balance`).
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from smartplay_tools.games.crafter import facts
from smartplay_tools.games.crafter.player import CrafterPlayer
from smartplay_tools.games.crafter.world import (
    COLUMN,
    DIRECTIONS,
    DISTANCE,
    TOWARD_LONGER,
    TOWARD_SHORTER,
    Chunk,
    Thing,
    World,
    place,
)

FREE = bytes(material in facts.WALKABLE for material in range(len(facts.NAMES)))
FREE_FOR_ARROW = bytes(material in facts.WALKABLE_FOR_ARROW for material in range(len(facts.NAMES)))


def _walk(world: World, thing: Thing, direction: int) -> bool:
    target = thing.at + direction
    if not FREE[world.surface[target]]:
        return False
    world.move(thing, target)
    return True


def cow(world: World, thing: Thing, player: CrafterPlayer) -> None:
    """Wander now and then."""
    if not thing.health:
        world.remove(thing)
    if world.stream.uniform() < 0.5:
        _walk(world, thing, DIRECTIONS[world.stream.quarter()])


def zombie(world: World, thing: Thing, player: CrafterPlayer) -> None:
    """Chase a player who is close, and strike one who is in reach."""
    stream = world.stream
    if not thing.health:
        world.remove(thing)
    if DISTANCE[thing.at - player.at] <= 8 and stream.uniform() < 0.9:
        toward = TOWARD_LONGER if stream.uniform() < 0.8 else TOWARD_SHORTER
        _walk(world, thing, toward[player.at - thing.at])
    else:
        _walk(world, thing, DIRECTIONS[stream.quarter()])
    if DISTANCE[thing.at - player.at] <= 1:
        if thing.clock:
            thing.clock -= 1
        else:
            player.hurt(7 if player.sleeping else 2)
            thing.clock = 5


def skeleton(world: World, thing: Thing, player: CrafterPlayer) -> None:
    """Keep away from the player, shoot, or come nearer."""
    stream = world.stream
    if not thing.health:
        world.remove(thing)
    thing.clock = max(0, thing.clock - 1)
    away = thing.at - player.at
    distance = DISTANCE[away]
    if distance <= 3:
        toward = TOWARD_LONGER if stream.uniform() < 0.6 else TOWARD_SHORTER
        if _walk(world, thing, -toward[-away]):
            return
    if distance <= 5 and stream.uniform() < 0.5:
        _shoot(world, thing, TOWARD_LONGER[-away])
    elif distance <= 8 and stream.uniform() < 0.3:
        toward = TOWARD_LONGER if stream.uniform() < 0.6 else TOWARD_SHORTER
        _walk(world, thing, toward[-away])
    elif stream.uniform() < 0.2:
        _walk(world, thing, DIRECTIONS[stream.quarter()])


def _shoot(world: World, thing: Thing, direction: int) -> None:
    target = thing.at + direction
    if not thing.clock and direction and FREE_FOR_ARROW[world.surface[target]]:
        world.add(Thing(facts.ARROW, target, direction))
        thing.clock = 4


def arrow(world: World, thing: Thing, player: CrafterPlayer) -> None:
    """Fly on, or disappear at an obstacle."""
    target = thing.at + thing.heading
    hit = world.surface[target]
    if FREE_FOR_ARROW[hit]:
        world.move(thing, target)
        return
    if hit == facts.PLAYER:
        player.hurt(2)
    elif hit > facts.PLAYER:
        other = world.thing_at(target)
        other.health = max(0, other.health - 2)
    world.remove(thing)
    if hit in (facts.TABLE, facts.FURNACE):
        world.set_ground(target, facts.PATH)


def plant(world: World, thing: Thing, player: CrafterPlayer) -> None:
    """Grow; a creature next to it eats it."""
    thing.clock += 1
    if any(
        world.surface[thing.at + direction] in (facts.COW, facts.ZOMBIE, facts.SKELETON) for direction in DIRECTIONS
    ):
        thing.health = 0
    if not thing.health:
        world.remove(thing)


UPDATE: dict[int, Callable[[World, Thing, CrafterPlayer], None]] = {
    facts.COW: cow,
    facts.ZOMBIE: zombie,
    facts.SKELETON: skeleton,
    facts.ARROW: arrow,
    facts.PLANT: plant,
}
"""The function for a thing's turn, by kind."""


INTERVAL = 10


class Light(NamedTuple):
    """The effects of the time of day on the rules."""

    daylight: float
    night: bool
    """Whether the picture is so dark that it gets noise, for which random numbers are drawn."""
    zombies: int
    """The most zombies that a chunk should have, which is also the fewest if it has enough grass."""
    cows: int
    """The most cows that a chunk should have."""


@functools.lru_cache(maxsize=20_000)
def light(step: int) -> Light:
    """The light at a step, in Crafter's scalar arithmetic: numpy's arrays round a cosine differently."""
    progress = (step / 300) % 1 + 0.3
    daylight = float(1 - np.abs(np.cos(np.pi * progress)) ** 3)
    return Light(daylight, daylight < 0.5, int(3.5 - 3 * daylight), int(1.5 + daylight))


class Rule(NamedTuple):
    """When a creature appears and disappears: materials, distances from the player, probabilities."""

    kind: int
    material: int
    space: int
    """A chunk with fewer cells of the material gets no creature."""
    least_distance: int
    leave_distance: int
    come: float
    leave: float


ZOMBIES = Rule(facts.ZOMBIE, facts.GRASS, 50, 6, 0, 0.3, 0.4)
SKELETONS = Rule(facts.SKELETON, facts.PATH, 6, 7, 7, 0.1, 0.1)
COWS = Rule(facts.COW, facts.GRASS, 30, 5, 5, 0.01, 0.1)


def balance(world: World, at: int, now: Light) -> None:
    """Add and remove creatures, given the player's place. Chunks that nothing has entered yet have none."""
    rules = (
        (ZOMBIES, world.grass, now.zombies, now.zombies),
        (SKELETONS, world.paths, 1, 2),
        (COWS, world.grass, 1, now.cows),
    )
    for key, chunk in list(world.chunks.items()):
        for rule, cells, least, most in rules:
            count = chunk.counts[rule.kind]
            if count < least and cells[key] >= rule.space:
                _come(world, at, key, rule, cells[key])
            elif count > most:
                _leave(world, at, chunk, rule, count)


def _come(world: World, at: int, key: int, rule: Rule, cells: int) -> None:
    if world.stream.uniform() < rule.come:
        where = _nth_cell(world, key, rule.material, world.stream.below(cells))
        if world.surface[where] < facts.PLAYER and DISTANCE[where - at] >= rule.least_distance:
            world.add(Thing(rule.kind, where))


def _leave(world: World, at: int, chunk: Chunk, rule: Rule, count: int) -> None:
    if world.stream.uniform() < rule.leave:
        creatures = [thing for thing in chunk.things if thing.kind == rule.kind]
        creature = creatures[world.stream.below(count)]
        if DISTANCE[creature.at - at] >= rule.leave_distance:
            world.remove(creature)


def _nth_cell(world: World, key: int, material: int, n: int) -> int:
    """The n-th cell of a material in a chunk, column by column."""
    x, y = key // facts.CHUNKS * facts.CHUNK, key % facts.CHUNKS * facts.CHUNK
    height = min(facts.CHUNK, facts.AREA - y)
    for column in range(place(x, y), place(x + facts.CHUNK, y), COLUMN):
        in_column = world.ground.count(material, column, column + height)
        if n < in_column:
            cell = column - 1
            for _ in range(n + 1):
                cell = world.ground.find(material, cell + 1, column + height)
            return cell
        n -= in_column
    raise AssertionError("The chunk has fewer cells of the material than it counts.")
