"""Crafter's fast engine beside PyPI `crafter`, in one world that is edited while it runs, in both alike.

What play hardly ever meets - borders, ores, stations, ripe plants, arrows - is met often this way.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Callable, Iterable
from contextlib import nullcontext
from itertools import repeat
from typing import Any
from unittest.mock import patch

import numpy as np
from crafter import constants, objects

from smartplay_tools.games.crafter import facts
from smartplay_tools.games.crafter.fast import FastEngine
from smartplay_tools.games.crafter.pictures import draw
from smartplay_tools.games.crafter.text import describe
from smartplay_tools.games.crafter.world import DIRECTIONS, Thing, place, position
from smartplay_tools.games.crafter.worldgen import FIELDS, points
from tests.games.reference import ReferenceEngine

ACTION = {name: number for number, name in enumerate(facts.ACTIONS)}
CREATURES = (facts.COW, facts.ZOMBIE, facts.SKELETON)


# --- The engines, each with the same edits of free cells inside the map -----------------------------------------------


@functools.cache
def noise_places() -> list[tuple[float, float, float]]:
    """Where a world asks for noise, in the order of the fast engine's values."""
    return [at for x, y, z in FIELDS.values() for at in zip(x.tolist(), y.tolist(), repeat(z), strict=False)]


class Noise:
    """The fast engine's noise in `opensimplex`'s place, which takes seconds for a world: tests compare the two."""

    def __init__(self, seed: int) -> None:
        values = dict(zip(noise_places(), points().values(seed).tolist(), strict=True))
        self.noise3 = lambda *at: values[at]


class Package(ReferenceEngine):
    """PyPI `crafter`, which draws what is compared, and every picture that takes random numbers: those of the night."""

    def __init__(self, seed: int, episode: int, *, quickly: bool) -> None:
        with patch("opensimplex.OpenSimplex", Noise) if quickly else nullcontext():
            super().__init__(seed, episode)
        draw_now = self.env._obs
        self.env._obs = lambda: draw_now() if self.env._world.daylight < 0.5 else None

    def drawn(self) -> np.ndarray:
        return self.env.render() if self.picture is None else self.picture

    def give(self, amounts: dict[str, int]) -> None:
        self.env._player.inventory.update(amounts)

    def set_ground(self, x: int, y: int, material: int) -> None:
        self.env._world[x, y] = facts.NAMES[material]

    def move_player(self, x: int, y: int) -> None:
        self.env._world.move(self.env._player, (x, y))

    def add(self, kind: int, x: int, y: int, clock: int, heading: int) -> None:
        world, player = self.env._world, self.env._player
        made = {
            facts.COW: lambda: objects.Cow(world, (x, y)),
            facts.ZOMBIE: lambda: objects.Zombie(world, (x, y), player),
            facts.SKELETON: lambda: objects.Skeleton(world, (x, y), player),
            facts.ARROW: lambda: objects.Arrow(world, (x, y), np.array(((-1, 0), (1, 0), (0, -1), (0, 1))[heading])),
            facts.PLANT: lambda: objects.Plant(world, (x, y)),
        }[kind]()
        for name in ("cooldown", "reload", "grown"):
            if name in vars(made):
                setattr(made, name, clock)
        world.add(made)


class Fast(FastEngine):
    """The engine in Python."""

    def __init__(self, seed: int, episode: int) -> None:
        super().__init__(seed, episode)

    def give(self, amounts: dict[str, int]) -> None:
        self.player.inventory.update(amounts)

    def set_ground(self, x: int, y: int, material: int) -> None:
        self.world.set_ground(place(x, y), material)

    def move_player(self, x: int, y: int) -> None:
        world, player = self.world, self.player
        world.surface[player.at] = world.ground[player.at]
        player.at = place(x, y)
        world.surface[player.at] = facts.PLAYER
        world.visit(player.at)
        world.list_near(player.at)

    def add(self, kind: int, x: int, y: int, clock: int, heading: int) -> None:
        thing = Thing(kind, place(x, y), DIRECTIONS[heading] if kind == facts.ARROW else 0)
        thing.clock = clock
        self.world.add(thing)


# --- All in the same world --------------------------------------------------------------------------------------------


class Pair:
    """A world in the fast engine and in the package."""

    def __init__(self, seed: int, episode: int = 1, *, quickly: bool = False) -> None:
        self.ours, self.package = Fast(seed, episode), Package(seed, episode, quickly=quickly)
        self.both = (self.ours, self.package)
        self.steps = 0

    @property
    def position(self) -> tuple[int, int]:
        return position(self.ours.sight().at)

    def _is_free(self, x: int, y: int) -> bool:
        inside = 0 <= x < facts.AREA and 0 <= y < facts.AREA
        return inside and self.ours.sight().surface[place(x, y)] < facts.PLAYER

    def give(self, **amounts: int) -> None:
        for engine in self.both:
            engine.give(amounts)

    def material(self, x: int, y: int, material: int) -> None:
        if 0 <= x < facts.AREA and 0 <= y < facts.AREA:
            for engine in self.both:
                engine.set_ground(x, y, material)

    def teleport(self, x: int, y: int) -> None:
        if self._is_free(x, y):
            self.material(x, y, facts.GRASS)
            for engine in self.both:
                engine.move_player(x, y)

    def thing(self, kind: int, x: int, y: int, *, clock: int = 0, heading: int = 0) -> None:
        if self._is_free(x, y):
            for engine in self.both:
                engine.add(kind, x, y, clock, heading)

    def step(self, action: int) -> bool:
        """Step both and compare everything that is visible; return whether the player is dead."""
        assert self.ours.step(action) == self.package.step(action)
        ours, package = self.ours.sight(), self.package.sight()
        assert bytes(ours.surface) == package.surface
        assert (ours.at, ours.facing, ours.sleeping) == (package.at, package.facing, package.sleeping)
        assert ours.inventory == package.inventory
        dead = self.package.health <= 0
        assert describe(ours, action, dead=dead) == plain_description(self.package.env, action)
        self.steps += 1
        if self.steps % 10 == 0 or dead:
            self.compare_everything()
        return dead

    def compare_everything(self) -> None:
        assert canonical(self.ours.state()) == canonical(self.package.state())
        assert self.ours.fingerprint() == self.package.fingerprint(), "the random streams"
        assert np.array_equal(draw(self.ours.scene()), self.package.drawn())


def canonical(state: object) -> str:
    return json.dumps(state, sort_keys=True)


def plain_description(env: Any, action: int) -> str:
    """The original's text, computed from PyPI crafter's own data in the simplest possible way."""
    player, seen = env._player, env._sem_view()
    x, y = player.pos
    view = seen[x - 4 : x + 5, y - 3 : y + 4]
    try:
        front = facts.NAMES[view[4 + player.facing[0], 3 + player.facing[1]]]
    except IndexError:
        return "Error, you are out of the map."
    lines = []
    for kind in np.unique(view):
        if kind == facts.PLAYER:
            continue
        dx, dy = min((np.argwhere(view == kind) - (4, 3)).tolist(), key=lambda d: abs(d[0]) + abs(d[1]))
        north_south = "north" * (dy < 0) + "south" * (dy > 0)
        west_east = "west" * (dx < 0) + "east" * (dx > 0)
        direction = f"{north_south}-{west_east}".strip("-")
        lines.append(f"- {facts.NAMES[kind]} {abs(dx) + abs(dy)} steps to your {direction}")
    name = facts.ACTIONS[action]
    for engine, in_text in (("_left", "_west"), ("_right", "_east"), ("_up", "_north"), ("_down", "_south")):
        name = name.replace(engine, in_text)
    status = ""
    if player.sleeping:
        status = "You are sleeping, and will not be able take actions until energy is full.\n\n"
    elif player.health <= 0:
        status = "You died.\n\n"
    carried = {item: count for item, count in player.inventory.items() if item not in facts.VITALS and count}
    return "\n".join(
        [
            f"You took action {name}.{status}",
            "",
            *(["You see:", *lines] if lines else ["You see nothing away from you."]),
            "",
            f"You face {front} at your front.",
            "",
            "Your status:",
            *(f"- {vital}: {player.inventory[vital]}/9" for vital in facts.VITALS),
            "",
            *(["Your inventory:"] if carried else ["You have nothing in your inventory."]),
            *(f"- {item}: {count}" for item, count in carried.items()),
        ]
    )


# --- Policies: each may edit the pair and returns an action -----------------------------------------------------------

Policy = Callable[[Pair, np.random.Generator], int]


def random_play(pair: Pair, rng: np.random.Generator) -> int:
    return int(rng.integers(17))


def sleep_a_lot(pair: Pair, rng: np.random.Generator) -> int:
    if pair.steps % 60 == 0:
        pair.give(energy=int(rng.integers(4)), food=9, drink=9)
    if pair.steps % 150 == 0:
        pair.give(health=9)
    return ACTION["sleep"] if rng.random() < 0.8 else int(rng.integers(17))


def walk_the_border(pair: Pair, rng: np.random.Generator) -> int:
    if pair.steps % 25 == 0:
        along, across = int(rng.integers(64)), int(rng.choice([0, 1, 2, 3, 4, 60, 61, 62, 63]))
        pair.teleport(*((along, across) if rng.random() < 0.5 else (across, along)))
        pair.give(health=9, food=9, drink=9, wood=9, sapling=2)
        pair.material(*(np.array(pair.position) + rng.integers(-2, 3, 2)).tolist(), facts.TABLE)
    return int(rng.integers(17))


def craft_and_fight(pair: Pair, rng: np.random.Generator) -> int:
    if pair.steps % 20 == 0:
        items = {item: int(rng.integers(10)) for item in facts.ITEMS}
        pair.give(**items, health=9, food=int(rng.integers(10)), drink=int(rng.integers(10)))
    if pair.steps % 3 == 0:
        x, y = (np.array(pair.position) + rng.integers(-3, 4, 2)).tolist()
        kind = int(rng.integers(1, 19))
        if kind in (*CREATURES, facts.ARROW, facts.PLANT):
            clock = 298 if kind == facts.PLANT else 0
            pair.thing(kind, x, y, clock=clock, heading=int(rng.integers(4)))
        elif kind not in (facts.PLAYER, facts.LAVA) and (x, y) != pair.position:
            pair.material(x, y, kind)
    return ACTION["do"] if rng.random() < 0.5 else int(rng.integers(17))


def meet_something_new(pair: Pair, rng: np.random.Generator) -> int:
    """In every step something else is ahead; tools, stations and energy come and go."""
    if pair.steps % 8 == 0:
        # Half of the items are missing, and half are plenty.
        pair.give(**{item: int(9 * rng.integers(2)) for item in facts.ITEMS})
        pair.give(health=9, food=int(rng.integers(10)), drink=int(rng.integers(10)), energy=int(rng.integers(3, 10)))
        x, y = pair.position
        for dx, station in ((-1, facts.TABLE), (1, facts.FURNACE)):
            pair.material(x + dx, y - 1, station if rng.random() < 0.7 else facts.SAND)
    sight = pair.ours.sight()
    x, y = position(sight.at + sight.facing)
    kind = int(rng.choice([kind for kind in range(1, len(facts.NAMES)) if kind != facts.PLAYER]))
    if kind > facts.PLAYER:
        pair.material(x, y, facts.GRASS)
        clocks = {facts.PLANT: range(299, 303), facts.ZOMBIE: range(6), facts.SKELETON: range(5)}
        clock = int(rng.choice(clocks.get(kind, [0])))
        pair.thing(kind, x, y, clock=clock, heading=int(rng.integers(4)))
    else:
        pair.material(x, y, kind)
    return ACTION["do"] if rng.random() < 0.6 else int(rng.integers(17))


def live_dangerously(pair: Pair, rng: np.random.Generator) -> int:
    if pair.steps % 10 == 0:
        x, y = (np.array(pair.position) + rng.integers(-3, 4, 2)).tolist()
        if (x, y) != pair.position:
            pair.material(x, y, facts.LAVA)
        pair.thing(facts.ZOMBIE, x + 1, y)
    return int(rng.integers(17))


def live_long(pair: Pair, rng: np.random.Generator) -> int:
    if pair.steps % 20 == 0:
        pair.give(health=9, food=9, drink=9, energy=int(rng.integers(3, 10)))
    return int(rng.choice([1, 2, 3, 4, 5, 6, 7, 0]))


POLICIES: tuple[Policy, ...] = (
    random_play,
    sleep_a_lot,
    walk_the_border,
    craft_and_fight,
    meet_something_new,
    live_dangerously,
)


# --- Play -------------------------------------------------------------------------------------------------------------

EVERYTHING = frozenset(
    {*facts.ACTIONS, *constants.achievements, "death", "lava", "arrow", "ripe plant", "border", "night"}
)
"""What a comparison of the rules has to meet."""


def play(policies: Iterable[Policy], seed: int, steps: int) -> set[str]:
    """Run policies, each for some steps; after a death the next episode begins. Returns what was met."""
    rng = np.random.default_rng([seed, steps])
    pair, episode, met = Pair(seed, quickly=True), 1, set[str]()
    pair.compare_everything()
    for policy in policies:
        for _ in range(steps):
            action = policy(pair, rng)
            dead = pair.step(action)
            met |= {facts.ACTIONS[action], *seen(pair.package)}
            if dead:
                episode += 1
                pair = Pair(seed, episode, quickly=True)
        pair.compare_everything()
    return met


def seen(package: Package) -> Iterable[str]:
    """What a step has met, by the package's own state."""
    player, world = package.env._player, package.env._world
    yield from (name for name, count in player.achievements.items() if count)
    happened = {
        "death": package.health <= 0,
        "lava": world[player.pos][0] == "lava",
        "arrow": any(isinstance(thing, objects.Arrow) for thing in world.objects),
        "ripe plant": any(isinstance(thing, objects.Plant) and thing.ripe for thing in world.objects),
        "border": 0 in player.pos or facts.AREA - 1 in player.pos,
        "night": world.daylight < 0.5,
    }
    yield from (name for name, happens in happened.items() if happens)
