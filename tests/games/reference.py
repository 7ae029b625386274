"""The reference engine: PyPI `crafter` itself, with one change that makes it reproducible.

Stock Crafter keeps the things of a chunk in a set, ordered by memory address, and picks the creature that disappears by
its index in that order, so two runs with the same seed soon differ. Here chunks keep their things in the order of
arrival. The probabilities stay the same, because the pick is uniform in any order. Everything else is the package's own
code, including the drawing of every picture, because at night pictures draw from the world's random stream.
"""

from __future__ import annotations

import collections
from typing import Any

import crafter
import numpy as np
from crafter import constants, engine, objects
from numpy.typing import NDArray

from smartplay_tools.games.crafter.facts import AREA, CHUNK, CHUNKS, NAMES
from smartplay_tools.games.crafter.stream import twister_bytes
from smartplay_tools.games.crafter.views import Scene, Sight
from smartplay_tools.games.crafter.world import COLUMN, IN_VIEW, MARGIN, cells_around, place, position

_DIRECTIONS = ((-1, 0), (1, 0), (0, -1), (0, 1))


class _InOrder(dict[Any, None]):
    """The methods of a set that a chunk uses, with the order of a dict."""

    def add(self, thing: Any) -> None:
        self[thing] = None

    def remove(self, thing: Any) -> None:
        del self[thing]


class _Random:
    """The draws that Crafter makes; keeps the last array of draws, which is the noise of a picture at night."""

    def __init__(self, seed: int | None) -> None:
        self.state = np.random.RandomState(seed)
        self.grain: NDArray[np.float64] | None = None

    def randint(self, low: int, high: int) -> int:
        return int(self.state.randint(low, high))

    def uniform(self, low: float = 0.0, high: float = 1.0, size: tuple[int, ...] | None = None) -> Any:
        if size is None:
            return self.state.uniform(low, high)
        self.grain = self.state.random_sample(size)
        return low + (high - low) * self.grain


class _World(engine.World):  # type: ignore[misc]
    def reset(self, seed: int | None = None) -> None:
        super().reset(seed)
        self.random = _Random(seed)
        self._chunks: dict[Any, _InOrder] = collections.defaultdict(_InOrder)


class ReferenceEngine:
    """A world of PyPI `crafter`.

    Attributes:
        steps: the steps since the world began.
        env: the package's environment.
        picture: the picture that the package drew in the last step, at its usual size.
    """

    def __init__(self, seed: int, episode: int) -> None:
        self.steps = 0
        # The engine has no limit of steps; the environment ends the episode.
        self.env = crafter.Env(seed=seed, length=None)
        world = _World(self.env._area, constants.materials, (CHUNK, CHUNK))
        for holder in (self.env, self.env._local_view, self.env._sem_view):
            holder._world = world
        self.env._episode = episode - 1
        self.picture: NDArray[np.uint8] = self.env.reset()

    @property
    def health(self) -> int:
        """The player's health; at 0 it is dead."""
        return int(self.env._player.health)

    @property
    def unlocked(self) -> int:
        """How many achievements have been unlocked."""
        return len(self.env._unlocked)

    def step(self, action: int) -> float:
        """Play an action; return the reward."""
        self.steps += 1
        self.env._world.random.grain = None
        self.picture, reward, _, _ = self.env.step(action)
        return float(reward)

    def sight(self) -> Sight:
        """The part of the state that the observation text describes."""
        player = self.env._player
        facing = COLUMN * player.facing[0] + player.facing[1]
        return Sight(
            _with_margin(self.env._sem_view()), place(*player.pos.tolist()), facing, player.inventory, player.sleeping
        )

    def scene(self) -> Scene:
        """The part of the state that a picture shows."""
        world, player = self.env._world, self.env._player
        at = place(*player.pos.tolist())
        placed = [(thing.texture, IN_VIEW.get(place(*thing.pos.tolist()) - at)) for thing in world.objects]
        return Scene(
            ground=cells_around(_with_margin(world._mat_map), at),
            things=[(texture, *cell) for texture, cell in placed if cell is not None],
            position=position(at),
            inventory=player.inventory,
            sleeping=player.sleeping,
            daylight=float(world.daylight),
            grain=world.random.grain,
        )

    def state(self) -> Any:
        """The whole state except the random stream, as JSON; the same as the fast engine's."""
        world, player = self.env._world, self.env._player
        things = [thing for thing in world.objects if thing is not player]
        number = {thing: n for n, thing in enumerate(things)}
        return [
            self.steps,
            int(self.env._last_health),
            [
                player.pos.tolist(),
                _DIRECTIONS.index(tuple(player.facing)),
                [int(amount) for amount in player.inventory.values()],
                {name: count for name, count in player.achievements.items() if count},
                player.sleeping,
                [float(n) for n in (player._hunger, player._thirst, player._fatigue, player._recover)],
                int(player._last_health),
            ],
            [
                world._mat_map.tobytes().hex(),
                [_thing_state(thing) for thing in things],
                [
                    [int(x // CHUNK * CHUNKS + y // CHUNK), [number[t] for t in chunk if t is not player]]
                    for (x, _, y, _), chunk in world.chunks.items()
                ],
            ],
        ]

    def fingerprint(self) -> bytes:
        """The state of the random stream."""
        return twister_bytes(self.env._world.random.state.get_state(legacy=False)["state"])


def _with_margin(cells: NDArray[Any]) -> bytes:
    """The cells of a map with the margin of `world`."""
    padded = np.zeros((AREA + 2 * MARGIN, COLUMN), np.uint8)
    padded[MARGIN : MARGIN + AREA, MARGIN : MARGIN + AREA] = cells
    return padded.tobytes()


def _thing_state(thing: Any) -> list[int]:
    kind = NAMES.index(type(thing).__name__.lower())
    clock = next((vars(thing)[name] for name in ("cooldown", "reload", "grown") if name in vars(thing)), 0)
    heading = _DIRECTIONS.index(tuple(thing.facing.tolist())) if isinstance(thing, objects.Arrow) else 0
    return [kind, *thing.pos.tolist(), int(thing.health), clock, heading]
