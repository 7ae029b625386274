"""Crafter for reinforcement learning: one world, observed as a picture, as ids or as numbers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from smartplay_tools.errors import InvalidArgumentError, ResetNeededError
from smartplay_tools.games.crafter.facts import ACHIEVEMENTS, ACTIONS, CARRIED, LENGTH, NOOP
from smartplay_tools.games.crafter.game import SMALLEST_PICTURE, Crafter
from smartplay_tools.games.crafter.observations import IMAGE, OBSERVATIONS, TEXT, space_of
from smartplay_tools.games.crafter.pictures import draw
from smartplay_tools.games.crafter.worlds import make_worlds
from smartplay_tools.games.seeds import check_seed

_ONE = np.zeros(1, np.intp)
DRAWN_SEEDS = 2**31 - 1
"""If no seed is given, one of this many is drawn."""


def make(*, observation: str = TEXT, history: int | None = None, **options: Any) -> gymnasium.Env[Any, Any]:
    """Make the environment of `gymnasium.make("smartplay/Crafter-v0")`: the text game or, by observation, `CrafterEnv`.

    Raises:
        InvalidArgumentError: `observation` is not one of "text", "image", "semantic" and "symbolic", or an option
            is not one that the observation has.
    """
    if observation == TEXT:
        return Crafter(history=history, **options)
    return CrafterEnv(observation=observation, **options)


class CrafterEnv(gymnasium.Env[NDArray[Any], Any]):
    """One world of Crafter; rewards, ends and states are those of the text game with the same seed and actions.

    Action space: `Discrete(17)`, in the order of PyPI `crafter`. Observation: see `observations`. Reward: a tenth of
    the change in health, and 1 in a step that unlocks achievements. Terminates at death, truncates at step 10,000.
    `info` has the keys of PyPI `crafter`; its `semantic` is the whole map, which no observation shows.

    `reset(seed=s)` begins the first episode of `crafter.Env(seed=s)`, and each further reset without a seed begins its
    next one.

    Arguments: `observation`, "image", "semantic" or "symbolic"; `engine`, "compiled" (numba, the extra `rl`) or "fast"
    (Python), by default compiled where numba is installed; `opening_noop`, whether the reset takes the first step, a
    noop, as the benchmark does (without it, the first observation is that of PyPI `crafter`); `picture_size`, the side
    of the pictures of `render` in pixels.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 4}  # noqa: RUF012 - Gymnasium's attribute

    def __init__(
        self,
        *,
        observation: str = IMAGE,
        engine: str | None = None,
        opening_noop: bool = True,
        render_mode: str | None = None,
        picture_size: int = SMALLEST_PICTURE,
    ) -> None:
        _check(observation, render_mode, picture_size)
        self.observation_space = space_of(observation)
        self.action_space = spaces.Discrete(len(ACTIONS))
        self.render_mode = render_mode
        self._observation = observation
        self._opening_noop = opening_noop
        self._picture_size = picture_size
        self._worlds = make_worlds(1, engine)
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
        elif self._seed is None:
            self._seed = int(self.np_random.integers(DRAWN_SEEDS))
        self._episode += 1
        self._worlds.begin(_ONE, [self._seed], [self._episode])
        if self._opening_noop:
            self._worlds.step(_ONE, np.array([NOOP]))
        self._playing = True
        return self._observe(), self._info(0.0)

    def step(self, action: Any) -> tuple[NDArray[Any], float, bool, bool, dict[str, Any]]:
        """Play an action; `ResetNeededError` before the first reset and after the end."""
        if not self._playing:
            raise ResetNeededError("CrafterEnv takes no step before its reset, nor after its end: call reset().")
        number = checked_actions(np.array([action]), 1)
        self._worlds.step(_ONE, number)
        reward = float(self._worlds.rewards[0])
        dead, over = bool(self._worlds.health[0] <= 0), bool(self._worlds.steps[0] >= LENGTH)
        self._playing = not (dead or over)
        return self._observe(), reward, dead, over, self._info(reward)

    def _observe(self) -> NDArray[Any]:
        out: NDArray[Any] = np.empty((1, *self.observation_space.shape), self.observation_space.dtype)  # type: ignore[misc]
        self._worlds.observe(self._observation, _ONE, out)
        seen: NDArray[Any] = out[0]
        return seen

    def _info(self, reward: float) -> dict[str, Any]:
        return {
            "inventory": dict(zip(CARRIED, self._worlds.carried[0].tolist(), strict=True)),
            "achievements": dict(zip(ACHIEVEMENTS, self._worlds.achievements[0].tolist(), strict=True)),
            "discount": 1 - float(self._worlds.health[0] <= 0),
            "semantic": self._worlds.semantic_map(0),
            "player_pos": self._worlds.positions[0],
            "reward": reward,
        }

    def render(self) -> Any:
        """Return the picture of the current state, with `render_mode="rgb_array"`."""
        return draw(self._worlds.scene(0), self._picture_size) if self.render_mode else None

    def state(self) -> Any:
        """The whole state except the random stream, as JSON; the same as that of the text game's engines."""
        return self._worlds.state(0)

    def fingerprint(self) -> bytes:
        """The state of the random stream."""
        return self._worlds.fingerprint(0)


def _check(observation: str, render_mode: str | None, picture_size: int) -> None:
    if observation not in OBSERVATIONS[1:]:
        raise InvalidArgumentError(f"observation must be one of {OBSERVATIONS}, not {observation!r}.")
    if render_mode not in (None, "rgb_array"):
        raise InvalidArgumentError(f"render_mode must be 'rgb_array' or None, not {render_mode!r}.")
    if picture_size < SMALLEST_PICTURE:
        raise InvalidArgumentError(f"picture_size must be {SMALLEST_PICTURE} or more, not {picture_size}.")


def checked_actions(actions: Any, count: int) -> NDArray[np.int64]:
    """One action for each world as integers.

    Raises:
        InvalidArgumentError: there are more or fewer actions than worlds, or one is not from 0 to 16.
    """
    numbers: NDArray[Any] = np.asarray(actions)
    if numbers.shape != (count,) or numbers.dtype.kind not in "iu":
        raise InvalidArgumentError(f"actions must be {count} integers, not {numbers.dtype} of shape {numbers.shape}.")
    if numbers.min() < 0 or numbers.max() >= len(ACTIONS):
        raise InvalidArgumentError(f"actions must be from 0 to {len(ACTIONS) - 1}, not {numbers.tolist()}.")
    return numbers.astype(np.int64, copy=False)


def named(names: tuple[str, ...], columns: NDArray[Any], mask: NDArray[np.bool_]) -> Mapping[str, Any]:
    """Columns by name, each with the mask that Gymnasium's vectors add to every key."""
    by_name: dict[str, Any] = {}
    for name, column in zip(names, columns.T, strict=True):
        by_name[name], by_name[f"_{name}"] = column, mask
    return by_name
