"""The fast engine: Crafter's rules without its pictures, with the same worlds, draws and trajectories."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from smartplay_tools.games.crafter.creatures import INTERVAL, UPDATE, balance, light
from smartplay_tools.games.crafter.facts import NIGHT_PIXELS, UPDATE_DISTANCE
from smartplay_tools.games.crafter.player import CrafterPlayer
from smartplay_tools.games.crafter.stream import world_seed
from smartplay_tools.games.crafter.views import CENTER, Scene, Sight, body_texture, thing_texture
from smartplay_tools.games.crafter.world import (
    DISTANCE,
    IN_VIEW,
    RELIST_STEPS,
    World,
    cells_around,
    position,
)


class FastEngine:
    """A world, its player and its clock.

    Attributes:
        steps: the steps since the world began.
        world, player: the parts.
    """

    def __init__(self, seed: int, episode: int) -> None:
        self.steps = 0
        self.world = World(world_seed(seed, episode))
        self.player = CrafterPlayer(self.world)
        self._grain: NDArray[np.float64] | None = None
        """The draws of a step at night, for its picture."""
        self._last_health = self.player.health

    def step(self, action: int) -> float:
        """Play an action; return the reward: a tenth of the change in health, and 1 for a new achievement."""
        self.steps += 1
        now, world, player = light(self.steps), self.world, self.player
        if self.steps % RELIST_STEPS == 1:
            world.list_near(player.at)
        # Things that appear in this step have their first turn in the next one.
        near, unlocked = world.near.copy(), len(player.unlocked)
        player.update(action)
        at = player.at
        for thing in near:
            if DISTANCE[thing.at - at] < UPDATE_DISTANCE:
                UPDATE[thing.kind](world, thing, player)
        if self.steps % INTERVAL == 0:
            balance(world, at, now)
        self._grain = world.stream.uniforms(NIGHT_PIXELS) if now.night else None
        health_change = player.health - self._last_health
        self._last_health = player.health
        return health_change / 10 + (len(player.unlocked) > unlocked)

    @property
    def health(self) -> int:
        """The player's health; at 0 it is dead."""
        return self.player.health

    @property
    def unlocked(self) -> int:
        """How many achievements have been unlocked."""
        return len(self.player.unlocked)

    def sight(self) -> Sight:
        """The part of the state that the observation text describes."""
        player = self.player
        return Sight(self.world.surface, player.at, player.facing, player.inventory, player.sleeping)

    def scene(self) -> Scene:
        """The part of the state that a picture shows."""
        player = self.player
        at = player.at
        body = body_texture(player.facing, sleeping=player.sleeping)
        things = [
            (thing_texture(thing.kind, thing.clock, thing.heading), *cell)
            for thing in self.world.near
            if (cell := IN_VIEW.get(thing.at - at)) is not None
        ]
        return Scene(
            ground=cells_around(self.world.ground, at),
            things=[(body, *CENTER), *things],
            position=position(at),
            inventory=player.inventory,
            sleeping=player.sleeping,
            daylight=light(self.steps).daylight,
            grain=self._grain,
        )

    def state(self) -> Any:
        """The whole state except the random stream, as JSON."""
        return [self.steps, self._last_health, self.player.state(), self.world.state()]

    def fingerprint(self) -> bytes:
        """The state of the random stream."""
        return self.world.stream.fingerprint()
