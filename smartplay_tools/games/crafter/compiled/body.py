"""The player of a compiled world: the rules of `player.CrafterPlayer` for actions and for what each step brings."""

from __future__ import annotations

from typing import Any

import numpy as np

from smartplay_tools.games.crafter.compiled.ground import add, is_creature, set_ground, thing_at, visit
from smartplay_tools.games.crafter.compiled.jit import inlined, kernel
from smartplay_tools.games.crafter.compiled.layout import id_table
from smartplay_tools.games.crafter.compiled.twister import uniform
from smartplay_tools.games.crafter.facts import (
    ACHIEVEMENTS,
    ACTIONS,
    CARRIED,
    COLLECT,
    COW,
    DAMAGE,
    LAVA,
    MAKE,
    MOST,
    NAMES,
    PLACE,
    PLANT,
    PLAYER,
    RIPE,
    SLEEP,
    WALKABLE_FOR_PLAYER,
    WATER,
    ZOMBIE,
)
from smartplay_tools.games.crafter.world import COLUMN, DIRECTIONS, MARGIN

_HEALTH, _FOOD, _DRINK, _ENERGY = range(4)
_ITEM = {name: number for number, name in enumerate(CARRIED)}
_ACHIEVEMENT = {name: number for number, name in enumerate(ACHIEVEMENTS)}
_WAKE_UP, _EAT_PLANT, _EAT_COW, _DEFEAT_ZOMBIE, _DEFEAT_SKELETON = (
    _ACHIEVEMENT[name] for name in ("wake_up", "eat_plant", "eat_cow", "defeat_zombie", "defeat_skeleton")
)
_FREE = id_table(WALKABLE_FOR_PLAYER)
_DIRECTIONS = np.array(DIRECTIONS, np.int64)

# The rules of `facts` as tables of numbers.
_SWORDS = np.array([(_ITEM[sword], damage) for sword, damage in DAMAGE], np.int64)
_COLLECTING = np.zeros(
    len(NAMES), np.dtype([("item", "i4"), ("tool", "i4"), ("leaves", "i4"), ("reaches", "i4"), ("probability", "f8")])
)
_COLLECTING["item"] = -1
for _material, _rule in COLLECT.items():
    _tool = -1 if _rule.tool is None else _ITEM[_rule.tool]
    _reaches = _ACHIEVEMENT[f"collect_{_rule.item}"]
    _COLLECTING[_material] = (_ITEM[_rule.item], _tool, _rule.leaves, _reaches, _rule.probability)

_FIRST_PLACE, _FIRST_MAKE = ACTIONS.index("place_stone"), ACTIONS.index("make_wood_pickaxe")
_USES = np.zeros((len(ACTIONS), len(CARRIED)), np.int64)
_PAID = [*(placing.uses for placing in PLACE.values()), *(making.uses for making in MAKE.values())]
for _number, _uses in enumerate(_PAID, _FIRST_PLACE):
    for _item, _count in _uses:
        _USES[_number, _ITEM[_item]] = _count
_WHERE = np.array([id_table(placing.where) for placing in PLACE.values()])
_PLACED = np.array([placing.what for placing in PLACE.values()], np.int64)
_NEARBY = np.array([id_table(making.nearby) for making in MAKE.values()])
_MADE = np.array([_ITEM[name] for name in MAKE], np.int64)
_REACHES = np.array([_ACHIEVEMENT.get(name, -1) for name in ACTIONS], np.int64)


@kernel
def reach(world: Any, achievement: int) -> None:
    """Count an achievement."""
    if world.achievements[achievement] == 0:
        world.unlocked += 1
    world.achievements[achievement] += 1


@kernel
def hurt(world: Any, damage: int) -> None:
    """Lose health."""
    world.inventory[_HEALTH] = max(0, world.inventory[_HEALTH] - damage)


@kernel
def _gain(world: Any, item: int) -> None:
    world.inventory[item] = min(world.inventory[item] + 1, MOST)


@kernel
def _pay(world: Any, action: int) -> bool:
    for item in range(len(CARRIED)):
        if world.inventory[item] < _USES[action, item]:
            return False
    for item in range(len(CARRIED)):
        world.inventory[item] -= _USES[action, item]
    return True


@kernel
def _move(world: Any, direction: int) -> None:
    target = world.at + direction
    world.facing = direction
    if _FREE[world.surface[target]]:
        world.surface[world.at] = world.ground[world.at]
        world.surface[target] = PLAYER
        visit(world, target)
        world.at = target
    if world.ground[world.at] == LAVA:
        world.inventory[_HEALTH] = 0


@kernel
def _touch(world: Any, thing: Any) -> None:
    if thing.kind == PLANT:
        if thing.clock > RIPE:
            thing.clock = 0
            world.inventory[_FOOD] += 4
            reach(world, _EAT_PLANT)
    elif is_creature(thing.kind):
        damage = 1
        for i in range(len(_SWORDS)):
            if world.inventory[_SWORDS[i, 0]]:
                damage = _SWORDS[i, 1]
                break
        thing.health = max(0, np.int64(thing.health) - damage)
        if thing.health == 0:
            if thing.kind == COW:
                world.inventory[_FOOD] += 6
                world.hunger = 0.0
                reach(world, _EAT_COW)
            else:
                reach(world, _DEFEAT_ZOMBIE if thing.kind == ZOMBIE else _DEFEAT_SKELETON)


@kernel
def _collect(world: Any, target: int, material: int) -> None:
    if material == WATER:
        world.thirst = 0.0
    rule = _COLLECTING[material]
    if rule.tool >= 0 and not world.inventory[rule.tool]:
        return
    if rule.leaves != material:
        set_ground(world, target, rule.leaves)
    # The number is drawn even if success is certain.
    if uniform(world) <= rule.probability:
        _gain(world, rule.item)
        reach(world, rule.reaches)


@kernel
def _do(world: Any, things: Any, near: Any) -> None:
    target = world.at + world.facing
    shown = world.surface[target]
    if shown > PLAYER:
        _touch(world, things[thing_at(world, things, near, target)])
    elif _COLLECTING[shown].item >= 0:
        _collect(world, target, shown)


@kernel
def _place(world: Any, things: Any, near: Any, action: int) -> None:
    target, number = world.at + world.facing, action - _FIRST_PLACE
    if not _WHERE[number, world.surface[target]] or not _pay(world, action):
        return
    if _PLACED[number] == PLANT:
        add(world, things, near, PLANT, target, 0)
    else:
        set_ground(world, target, _PLACED[number])
    reach(world, _REACHES[action])


@kernel
def _stands_nearby(world: Any, material: int) -> bool:
    """Whether a material is in the 3 x 3 cells around; at the western and northern edge nothing is."""
    if world.at // COLUMN == MARGIN or world.at % COLUMN == MARGIN:
        return False
    for across in range(-COLUMN, 2 * COLUMN, COLUMN):
        for down in range(-1, 2):
            if world.ground[world.at + across + down] == material:
                return True
    return False


@kernel
def _make(world: Any, action: int) -> None:
    number = action - _FIRST_MAKE
    for material in range(len(NAMES)):
        if _NEARBY[number, material] and not _stands_nearby(world, material):
            return
    if _pay(world, action):
        _gain(world, _MADE[number])
        reach(world, _REACHES[action])


@kernel
def _live(world: Any) -> None:
    """Get hungry, thirsty and tired."""
    has, pace = world.inventory, 0.5 if world.sleeping else 1.0
    world.hunger += pace
    if world.hunger > 25:
        world.hunger = 0.0
        has[_FOOD] = max(0, has[_FOOD] - 1)
    if has[_FOOD] > MOST:
        has[_FOOD] = MOST
    world.thirst += pace
    if world.thirst > 20:
        world.thirst = 0.0
        has[_DRINK] = max(0, has[_DRINK] - 1)
    world.fatigue = min(world.fatigue - 1, 0) if world.sleeping else world.fatigue + 1
    if world.fatigue < -10:
        world.fatigue = 0
        has[_ENERGY] = min(has[_ENERGY] + 1, MOST)
    elif world.fatigue > 30:
        world.fatigue = 0
        has[_ENERGY] = max(0, has[_ENERGY] - 1)


@kernel
def _recover(world: Any) -> None:
    """Gain health while nothing is lacking, lose it otherwise."""
    has, asleep = world.inventory, world.sleeping != 0
    if has[_FOOD] and has[_DRINK] and (has[_ENERGY] or asleep):
        world.recovery += 2.0 if asleep else 1.0
    else:
        world.recovery -= 0.5 if asleep else 1.0
    if world.recovery > 25:
        world.recovery = 0.0
        has[_HEALTH] = min(has[_HEALTH] + 1, MOST)
    if world.recovery < -15:
        world.recovery = 0.0
        hurt(world, 1)


@inlined
def take_turn(world: Any, things: Any, near: Any, action: int) -> None:
    """The player's turn. While it sleeps, every action is replaced by sleeping."""
    if world.sleeping:
        if world.inventory[_ENERGY] < MOST:
            action = SLEEP
        else:
            world.sleeping = 0
            reach(world, _WAKE_UP)
    if action >= _FIRST_MAKE:
        _make(world, action)
    elif action >= _FIRST_PLACE:
        _place(world, things, near, action)
    elif action == SLEEP:
        if world.inventory[_ENERGY] < MOST:
            world.sleeping = 1
    elif action > len(DIRECTIONS):
        _do(world, things, near)
    elif action > 0:
        _move(world, _DIRECTIONS[action - 1])
    _live(world)
    _recover(world)
    if world.inventory[_HEALTH] < world.last_health:
        world.sleeping = 0
    world.last_health = world.inventory[_HEALTH]
