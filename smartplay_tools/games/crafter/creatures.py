"""The turns of creatures, arrows and plants.

The order of all draws is Crafter's. As in Crafter, a creature without health is taken off the map at the beginning of
its turn but still takes the turn: a beaten zombie may strike once more.
"""

from __future__ import annotations

from collections.abc import Callable

from smartplay_tools.games.crafter.facts import (
    ARROW,
    COW,
    FURNACE,
    NAMES,
    PATH,
    PLANT,
    PLAYER,
    SKELETON,
    TABLE,
    WALKABLE,
    WALKABLE_FOR_ARROW,
    ZOMBIE,
)
from smartplay_tools.games.crafter.player import CrafterPlayer
from smartplay_tools.games.crafter.world import (
    DIRECTIONS,
    DISTANCE,
    TOWARD_LONGER,
    TOWARD_SHORTER,
    Thing,
    World,
)

FREE = bytes(material in WALKABLE for material in range(len(NAMES)))
FREE_FOR_ARROW = bytes(material in WALKABLE_FOR_ARROW for material in range(len(NAMES)))


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
        world.add(Thing(ARROW, target, direction))
        thing.clock = 4


def arrow(world: World, thing: Thing, player: CrafterPlayer) -> None:
    """Fly on, or disappear at an obstacle."""
    target = thing.at + thing.heading
    hit = world.surface[target]
    if FREE_FOR_ARROW[hit]:
        world.move(thing, target)
        return
    if hit == PLAYER:
        player.hurt(2)
    elif hit > PLAYER:
        other = world.thing_at(target)
        other.health = max(0, other.health - 2)
    world.remove(thing)
    if hit in (TABLE, FURNACE):
        world.set_ground(target, PATH)


def plant(world: World, thing: Thing, player: CrafterPlayer) -> None:
    """Grow; a creature next to it eats it."""
    thing.clock += 1
    if any(world.surface[thing.at + direction] in (COW, ZOMBIE, SKELETON) for direction in DIRECTIONS):
        thing.health = 0
    if not thing.health:
        world.remove(thing)


UPDATE: dict[int, Callable[[World, Thing, CrafterPlayer], None]] = {
    COW: cow,
    ZOMBIE: zombie,
    SKELETON: skeleton,
    ARROW: arrow,
    PLANT: plant,
}
"""The function for a thing's turn, by kind."""
