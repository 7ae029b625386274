"""The player: its state, and the effects of each action on it and on the world."""

from __future__ import annotations

from typing import Any

from smartplay_tools.games.crafter import facts
from smartplay_tools.games.crafter.world import (
    CHUNK_OF,
    COLUMN,
    DIRECTIONS,
    SOUTH,
    Thing,
    World,
    place,
    position,
)
from smartplay_tools.games.crafter.worldgen import CENTER

_FREE = bytes(material in facts.WALKABLE_FOR_PLAYER for material in range(len(facts.NAMES)))


class CrafterPlayer:
    """The player of a world.

    Attributes:
        at, facing: its place, and the direction of the cell in front of it.
        inventory: vitals and items by name.
        unlocked: how often each achievement was reached, in the order in which they were first reached.
        sleeping: whether it sleeps; only an injury or full energy wakes it.
    """

    def __init__(self, world: World) -> None:
        self.world = world
        self.at = place(CENTER, CENTER)
        self.facing = SOUTH
        self.inventory = dict.fromkeys(facts.VITALS, facts.MOST) | dict.fromkeys(facts.ITEMS, 0)
        self.unlocked: dict[str, int] = {}
        self.sleeping = False
        # Steps since the last change of a vital; asleep, hunger and thirst run at half speed.
        self._hunger: float = 0
        self._thirst: float = 0
        self._fatigue = 0
        self._recovery: float = 0
        self._last_health = facts.MOST

    @property
    def health(self) -> int:
        """Health, 0 to 9."""
        return self.inventory["health"]

    def hurt(self, damage: int) -> None:
        """Lose health."""
        self.inventory["health"] = max(0, self.inventory["health"] - damage)

    def update(self, action: int) -> None:
        """Take a turn. While the player sleeps, every action is replaced by sleeping."""
        if self.sleeping:
            if self.inventory["energy"] < facts.MOST:
                action = facts.SLEEP
            else:
                self.sleeping = False
                self._reach("wake_up")
        _ACT[action](self)
        self._live()
        self._recover()
        health = self.inventory["health"]
        if health < self._last_health:
            self.sleeping = False
        self._last_health = health

    # Actions.

    def _move(self, direction: int) -> None:
        world, target = self.world, self.at + direction
        self.facing = direction
        if _FREE[world.surface[target]]:
            world.surface[self.at] = world.ground[self.at]
            world.surface[target] = facts.PLAYER
            if CHUNK_OF[target] != CHUNK_OF[self.at]:
                world.visit(target)
            self.at = target
        if world.ground[self.at] == facts.LAVA:
            self.inventory["health"] = 0

    def _do(self) -> None:
        target = self.at + self.facing
        shown = self.world.surface[target]
        if shown > facts.PLAYER:
            self._touch(self.world.thing_at(target))
        elif shown in facts.COLLECT:
            self._collect(target, shown)

    def _touch(self, thing: Thing) -> None:
        if thing.kind == facts.PLANT:
            if thing.clock > facts.RIPE:
                thing.clock = 0
                self.inventory["food"] += 4
                self._reach("eat_plant")
        elif thing.kind in (facts.COW, facts.ZOMBIE, facts.SKELETON):
            thing.health = max(0, thing.health - self._damage())
            if not thing.health:
                self._defeat(thing.kind)

    def _damage(self) -> int:
        return next((damage for sword, damage in facts.DAMAGE if self.inventory[sword]), 1)

    def _defeat(self, kind: int) -> None:
        if kind == facts.COW:
            self.inventory["food"] += 6
            self._hunger = 0
            self._reach("eat_cow")
        else:
            self._reach(f"defeat_{facts.NAMES[kind]}")

    def _collect(self, target: int, material: int) -> None:
        if material == facts.WATER:
            self._thirst = 0
        tool, item, leaves, probability = facts.COLLECT[material]
        if tool and not self.inventory[tool]:
            return
        if leaves != material:
            self.world.set_ground(target, leaves)
        # The number is drawn even if success is certain.
        if self.world.stream.uniform() <= probability:
            self._gain(item)
            self._reach(f"collect_{item}")

    def _place(self, name: str) -> None:
        target = self.at + self.facing
        uses, where, what = facts.PLACE[name]
        if self.world.surface[target] not in where or not self._pay(uses):
            return
        if what == facts.PLANT:
            self.world.add(Thing(facts.PLANT, target))
        else:
            self.world.set_ground(target, what)
        self._reach(f"place_{name}")

    def _make(self, name: str) -> None:
        uses, nearby = facts.MAKE[name]
        around = self._around()
        if all(material in around for material in nearby) and self._pay(uses):
            self._gain(name)
            self._reach(f"make_{name}")

    def _around(self) -> bytes:
        """The materials of the 3 x 3 cells around.

        Empty at the map's western and northern edge: there, the original slices from -1, which is the other end
        of the map, and gets nothing.
        """
        if 0 in position(self.at):
            return b""
        ground, corner = self.world.ground, self.at - COLUMN - 1
        return b"".join(ground[start : start + 3] for start in (corner, corner + COLUMN, corner + 2 * COLUMN))

    def _sleep(self) -> None:
        if self.inventory["energy"] < facts.MOST:
            self.sleeping = True

    def _pay(self, uses: tuple[tuple[str, int], ...]) -> bool:
        if any(self.inventory[item] < count for item, count in uses):
            return False
        for item, count in uses:
            self.inventory[item] -= count
        return True

    def _gain(self, item: str) -> None:
        self.inventory[item] = min(self.inventory[item] + 1, facts.MOST)

    def _reach(self, achievement: str) -> None:
        self.unlocked[achievement] = self.unlocked.get(achievement, 0) + 1

    # The body.

    def _live(self) -> None:
        """Get hungry, thirsty and tired."""
        has, pace = self.inventory, 0.5 if self.sleeping else 1
        self._hunger += pace
        if self._hunger > 25:
            self._hunger = 0
            has["food"] = max(0, has["food"] - 1)
        # A meal may exceed the maximum for a moment, because it counts before hunger does.
        if has["food"] > facts.MOST:
            has["food"] = facts.MOST
        self._thirst += pace
        if self._thirst > 20:
            self._thirst = 0
            has["drink"] = max(0, has["drink"] - 1)
        self._fatigue = min(self._fatigue - 1, 0) if self.sleeping else self._fatigue + 1
        if self._fatigue < -10:
            self._fatigue = 0
            has["energy"] = min(has["energy"] + 1, facts.MOST)
        elif self._fatigue > 30:
            self._fatigue = 0
            has["energy"] = max(0, has["energy"] - 1)

    def _recover(self) -> None:
        """Gain health while nothing is lacking, lose it otherwise."""
        has, asleep = self.inventory, self.sleeping
        if has["food"] and has["drink"] and (has["energy"] or asleep):
            self._recovery += 2 if asleep else 1
        else:
            self._recovery -= 0.5 if asleep else 1
        if self._recovery > 25:
            self._recovery = 0
            has["health"] = min(has["health"] + 1, facts.MOST)
        if self._recovery < -15:
            self._recovery = 0
            self.hurt(1)

    def state(self) -> Any:
        """Everything, as JSON."""
        return [
            position(self.at),
            DIRECTIONS.index(self.facing),
            list(self.inventory.values()),
            self.unlocked,
            self.sleeping,
            [float(count) for count in (self._hunger, self._thirst, self._fatigue, self._recovery)],
            self._last_health,
        ]


def _action(name: str) -> Any:
    verb, _, rest = name.partition("_")
    if verb == "move":
        direction = DIRECTIONS[("left", "right", "up", "down").index(rest)]
        return lambda player: player._move(direction)
    if verb == "place":
        return lambda player: player._place(rest)
    if verb == "make":
        return lambda player: player._make(rest)
    return {"noop": lambda player: None, "do": CrafterPlayer._do, "sleep": CrafterPlayer._sleep}[name]


_ACT = tuple(_action(name) for name in facts.ACTIONS)
"""What each action does to a player."""
