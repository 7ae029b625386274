"""Crafter as a Gymnasium environment whose observation is a picture, ids or numbers instead of text."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from smartplay_tools.errors import InvalidArgumentError, ResetNeededError
from smartplay_tools.games.base import check_action
from smartplay_tools.games.crafter.facts import ACHIEVEMENTS, ACTIONS, AREA, LENGTH, NOOP
from smartplay_tools.games.crafter.fast import FastEngine
from smartplay_tools.games.crafter.game import SMALLEST_PICTURE, Crafter, next_episode
from smartplay_tools.games.crafter.observations import IMAGE, OBSERVATIONS, TEXT, observe, space_of
from smartplay_tools.games.crafter.pictures import draw
from smartplay_tools.games.crafter.world import position, without_margin
from smartplay_tools.games.seeds import check_seed


def make(*, observation: str = TEXT, history: int | None = None, **options: Any) -> gymnasium.Env[Any, Any]:
    """Make the environment of `gymnasium.make("smartplay/Crafter-v0")`: the text game or, by observation, `CrafterEnv`.

    Raises:
        InvalidArgumentError: `observation` is not one of "text", "image", "semantic" and "symbolic", or an option
            is not one that the observation has.
    """
    if observation == TEXT:
        return Crafter(history=history, **options)
    return CrafterEnv(observation=observation, **options)


# `gymnasium.make` reads from it which render modes its own wrappers can add: "human", and those that end in "_list".
make.metadata = Crafter.metadata  # type: ignore[attr-defined]


class CrafterEnv(gymnasium.Env[NDArray[Any], Any]):
    """Crafter without text; rewards, ends and states are those of the text game with the same seed and actions.

    Action space: `Discrete(17)`, in the order of PyPI `crafter`. Observation: see `observations`. Reward: a tenth of
    the change in health, and 1 in a step that unlocks achievements. Terminates at death, truncates at step 10,000.
    `info` has the keys of PyPI `crafter`; its `semantic` is the whole map, which no observation shows.

    `reset(seed=s)` begins the first episode of `crafter.Env(seed=s)`, and each further reset without a seed begins its
    next one. If the first reset has no seed, `np_random_seed` is the seed of its world.

    Arguments: `observation`, "image", "semantic" or "symbolic"; `engine`, which can only be "fast"; `opening_noop`,
    whether the reset takes the first step, a noop, as the benchmark does (without it, the first observation is that of
    PyPI `crafter`); `picture_size`, the side of the pictures of `render` in pixels.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 4}  # noqa: RUF012 - Gymnasium's attribute

    def __init__(
        self,
        *,
        observation: str = IMAGE,
        engine: str = "fast",
        opening_noop: bool = True,
        render_mode: str | None = None,
        picture_size: int = SMALLEST_PICTURE,
    ) -> None:
        if observation not in OBSERVATIONS[1:]:
            raise InvalidArgumentError(f"observation must be one of {OBSERVATIONS}, not {observation!r}.")
        if engine != "fast":
            raise InvalidArgumentError(
                f"engine must be 'fast', not {engine!r}: to train over many millions of steps, see docs/rl.md."
            )
        if render_mode not in (None, "rgb_array"):
            raise InvalidArgumentError(f"render_mode must be 'rgb_array' or None, not {render_mode!r}.")
        if picture_size < SMALLEST_PICTURE:
            raise InvalidArgumentError(f"picture_size must be {SMALLEST_PICTURE} or more, not {picture_size}.")
        self.observation_space = space_of(observation)
        self.action_space = spaces.Discrete(len(ACTIONS))
        self.render_mode = render_mode
        self._observation = observation
        self._opening_noop = opening_noop
        self._picture_size = picture_size
        self._world: FastEngine
        self._seed: int | None = None
        self._episode = 0
        self._playing = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[Any], dict[str, Any]]:
        """Start the first episode of a seed or, without one, the next episode."""
        seed = None if seed is None else check_seed(seed)
        super().reset(seed=seed)
        if seed is not None:
            self._seed, self._episode = seed, 0
        self._seed, self._episode = next_episode(self, self._seed, self._episode)
        self._world = FastEngine(self._seed, self._episode, keep_grain=True)
        if self._opening_noop:
            self._world.step(NOOP)
        self._playing = True
        return observe(self._world, self._observation), self._info(0.0)

    def step(self, action: Any) -> tuple[NDArray[Any], float, bool, bool, dict[str, Any]]:
        """Play an action; `ResetNeededError` before the first reset and after the end."""
        if not self._playing:
            raise ResetNeededError("CrafterEnv takes no step before its reset, nor after its end: call reset().")
        reward = float(self._world.step(check_action(action, ACTIONS, "CrafterEnv")))
        dead, over = self._world.health <= 0, self._world.steps >= LENGTH
        self._playing = not (dead or over)
        return observe(self._world, self._observation), reward, dead, over, self._info(reward)

    def _info(self, reward: float) -> dict[str, Any]:
        player, world = self._world.player, self._world.world
        return {
            "inventory": dict(player.inventory),
            "achievements": {name: player.unlocked.get(name, 0) for name in ACHIEVEMENTS},
            "discount": 1 - float(player.health <= 0),
            "semantic": np.frombuffer(without_margin(world.surface), np.uint8).reshape(AREA, AREA),
            "player_pos": np.array(position(player.at)),
            "reward": reward,
        }

    def render(self) -> Any:
        """Return the picture of the current state, with `render_mode="rgb_array"`."""
        return draw(self._world.scene(), self._picture_size) if self.render_mode else None

    def state(self) -> Any:
        """The whole state except the random stream, as JSON; the same as that of the text game's engines."""
        return self._world.state()

    def fingerprint(self) -> bytes:
        """The state of the random stream."""
        return self._world.fingerprint()
