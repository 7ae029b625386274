"""A step of a compiled world, in the order of `fast.FastEngine.step`, including the order of all draws."""

from __future__ import annotations

from typing import Any

from smartplay_tools.games.crafter.balance import INTERVAL
from smartplay_tools.games.crafter.compiled.body import take_turn
from smartplay_tools.games.crafter.compiled.ground import distance, list_near
from smartplay_tools.games.crafter.compiled.jit import inlined, kernel
from smartplay_tools.games.crafter.compiled.layout import KEY, MOST_ADDED
from smartplay_tools.games.crafter.compiled.others import balance, take_thing_turn
from smartplay_tools.games.crafter.compiled.twister import skip
from smartplay_tools.games.crafter.facts import NIGHT_PIXELS, UPDATE_DISTANCE
from smartplay_tools.games.crafter.world import RELIST_STEPS


@inlined
def step(world: Any, things: Any, near: Any, light: Any, action: int) -> float:
    """Play an action; return the reward. `things` needs `room_needed` rows, and `light` a row for this step."""
    world.steps += 1
    now = light[world.steps]
    if world.steps % RELIST_STEPS == 1:
        list_near(world, things, near)
    # Things that appear in this step have their first turn in the next one.
    listed, unlocked = world.near_count, world.unlocked
    take_turn(world, things, near, action)
    for i in range(listed):
        thing = things[near[i]]
        if not thing.removed and distance(thing.at, world.at) < UPDATE_DISTANCE:
            take_thing_turn(world, things, near, thing)
    if world.steps % INTERVAL == 0:
        balance(world, things, near, now)
    if now.night:
        for i in range(KEY):
            world.night_key[i] = world.key[i]
        world.night_word = world.word
        skip(world, 2 * NIGHT_PIXELS)
    health_change = world.inventory[0] - world.rewarded_health
    world.rewarded_health = world.inventory[0]
    return health_change / 10 + (1 if world.unlocked > unlocked else 0)


@kernel
def room_needed(world: Any) -> int:
    """How many things there may be after the next step: each near skeleton may shoot, each chunk may get creatures."""
    return world.thing_count + world.near_count + MOST_ADDED
