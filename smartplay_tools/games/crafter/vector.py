"""Crafter for reinforcement learning: many worlds at once, as Gymnasium's vector environment."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from smartplay_tools.errors import InvalidArgumentError, ResetNeededError, check_choice
from smartplay_tools.games.base import Words
from smartplay_tools.games.crafter.environment import DRAWN_SEEDS, checked_actions, named
from smartplay_tools.games.crafter.facts import ACHIEVEMENTS, ACTIONS, CARRIED, LENGTH, NOOP
from smartplay_tools.games.crafter.game import TEXTS
from smartplay_tools.games.crafter.observations import OBSERVATIONS, TEXT, space_of
from smartplay_tools.games.crafter.pictures import draw
from smartplay_tools.games.crafter.text import CHARACTERS, LONGEST, describe
from smartplay_tools.games.crafter.worlds import Numbers, make_worlds
from smartplay_tools.games.seeds import check_seeds, whole

Mask = NDArray[np.bool_]


class CrafterVectorEnv(VectorEnv[Any, Any, NDArray[Any]]):
    """Many worlds of Crafter, as `gymnasium.make_vec("smartplay/Crafter-v0", num_envs=...)` returns them.

    World i with seed s plays what `gymnasium.make("smartplay/Crafter-v0", ...)` plays with seed s: the same
    observations, rewards, ends and states. `reset(seed=s)` gives world i the seed s + i, `reset(seed=[...])` each its
    own, and a reset without a seed begins the next episode of every world's seed, as does each automatic reset.
    Observations are arrays with a row for each world; texts are a tuple.

    `info` has the keys of PyPI `crafter` as arrays, `inventory` and `achievements` by name, each key with a mask
    `_key` as in all of Gymnasium; `semantic`, the whole map, only if asked for, since copying it takes longer than a
    step. `final_obs` and `final_info` are those of `SyncVectorEnv`.

    Arguments: `observation`, "text", "image", "semantic" or "symbolic"; `engine`, "compiled" (numba, the extra `rl`)
    or "fast" (Python), by default compiled where numba is installed, and otherwise fast with a warning;
    `autoreset_mode`, as in Gymnasium; `threads`, the number of threads that step the worlds of the compiled engine;
    `text` and `opening_noop`, as for a single world; `semantic`, whether `info` has the maps; `copy`, whether each step
    returns new arrays or fills the same array again; `max_episode_steps`, where an episode is truncated, 10,000 by
    default; `history` is accepted but unused, since only the `info` of the text game has a history.
    """

    closed = True
    """Nothing is open until worlds are made: older releases of Gymnasium close environments that refused options."""

    def __init__(
        self,
        num_envs: int = 1,
        *,
        observation: str = TEXT,
        engine: str | None = None,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        threads: int = 1,
        text: str = "original",
        opening_noop: bool = True,
        semantic: bool = False,
        copy: bool = True,
        max_episode_steps: int = LENGTH,
        render_mode: str | None = None,
        history: int | None = None,
    ) -> None:
        check_choice("observation", observation, OBSERVATIONS)
        check_choice("text", text, TEXTS)
        if render_mode not in (None, "rgb_array"):
            raise InvalidArgumentError(f"render_mode must be 'rgb_array' or None, not {render_mode!r}.")
        if num_envs < 1 or threads < 1:
            raise InvalidArgumentError(f"num_envs and threads must be 1 or more, not {num_envs} and {threads}.")
        self.num_envs = num_envs
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = {"render_modes": ["rgb_array"], "render_fps": 4, "autoreset_mode": self.autoreset_mode}
        self.render_mode = render_mode
        self.single_action_space = spaces.Discrete(len(ACTIONS))
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.single_observation_space = (
            Words(min_length=1, max_length=LONGEST, charset="".join(sorted(set(CHARACTERS))))
            if observation == TEXT
            else space_of(observation)
        )
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._observation = observation
        self._corrected = text == "corrected"
        self._opening_noop = opening_noop
        self._semantic = semantic
        self._copy = copy
        self._length = max_episode_steps
        self._worlds = make_worlds(num_envs, engine, threads=threads)
        self.closed = False
        self._all: Numbers = np.arange(num_envs)
        self._seeds: list[int | None] = [None] * num_envs
        self._episodes = [0] * num_envs
        self._steps = np.zeros(num_envs, np.int64)
        self._ended: Mask = np.zeros(num_envs, np.bool_)
        self._actions = np.full(num_envs, -1, np.int64)
        self._seen: Any = None

    # Resetting.

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode in every world, or with `options={"reset_mask": ...}` in the worlds of the mask."""
        seeds = check_seeds(seed, self.num_envs)
        which = self._all
        if options and "reset_mask" in options:
            which = self._masked(options["reset_mask"])
            self._check_begun(set(range(self.num_envs)) - set(which.tolist()), "without a reset_mask")
        super().reset(seed=whole(seed))
        self._begin(which, seeds)
        return self._observe(which), self._info(which)

    def _masked(self, mask: Any) -> Numbers:
        if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_ or mask.shape != (self.num_envs,):
            raise InvalidArgumentError(f"reset_mask must be an array of {self.num_envs} truth values.")
        if not mask.any():
            raise InvalidArgumentError("reset_mask must select at least one world.")
        return np.flatnonzero(mask)

    def _begin(self, which: Numbers, seeds: Sequence[int | None] | None = None) -> None:
        """Begin an episode in each world in `which`: the first of a seed, or the next."""
        numbers, played = which.tolist(), []
        for number in numbers:
            given = None if seeds is None else seeds[number]
            if given is not None:
                self._seeds[number], self._episodes[number] = given, 0
            seed = self._seeds[number]
            if seed is None:
                seed = self._seeds[number] = int(self.np_random.integers(DRAWN_SEEDS))
            self._episodes[number] += 1
            played.append(seed)
        self._worlds.begin(which, played, [self._episodes[number] for number in numbers])
        if self._opening_noop:
            self._worlds.step(which, np.full(self.num_envs, NOOP))
        self._worlds.rewards[which] = 0
        self._steps[which] = 0
        self._ended[which] = False
        self._actions[which] = -1

    def _check_begun(self, numbers: Iterable[int], how: str = "") -> None:
        if new := [number for number in numbers if self._episodes[number] == 0]:
            raise ResetNeededError(f"Worlds {new} have not begun: call reset() {how}".rstrip() + ".")

    # Playing.

    def step(self, actions: Any) -> tuple[Any, NDArray[np.float64], Mask, Mask, dict[str, Any]]:
        """Play an action in each world; worlds whose episode has ended are treated by the autoreset mode."""
        self._check_begun(range(self.num_envs))
        chosen = checked_actions(actions, self.num_envs)
        ended = np.flatnonzero(self._ended)
        if len(ended) and self.autoreset_mode == AutoresetMode.DISABLED:
            raise ResetNeededError(f"The episodes of worlds {ended.tolist()} have ended: reset them with a reset_mask.")
        playing = np.flatnonzero(~self._ended) if len(ended) else self._all
        self._worlds.step(playing, chosen)
        self._steps[playing] += 1
        self._actions[playing] = chosen[playing]
        if len(ended):
            self._begin(ended)
        rewards = self._worlds.rewards.copy()
        dead = self._worlds.health <= 0
        over = (self._worlds.steps >= LENGTH) | (self._steps >= self._length)
        self._ended = dead | over
        if self.autoreset_mode == AutoresetMode.SAME_STEP and self._ended.any():
            return self._same_step(rewards, dead, over)
        return self._observe(self._all), rewards, dead, over, self._info(self._all)

    def _same_step(
        self, rewards: NDArray[np.float64], dead: Mask, over: Mask
    ) -> tuple[Any, NDArray[np.float64], Mask, Mask, dict[str, Any]]:
        """Reset the worlds whose episode has ended, and return the final observations and infos."""
        ended, mask = np.flatnonzero(self._ended), self._ended.copy()
        last, final = self._observe(ended), np.full(self.num_envs, None, object)
        for number in ended.tolist():
            final[number] = last[number] if isinstance(last, tuple) else last[number].copy()
        final_info = self._info(ended)
        self._begin(ended)
        info = self._info(self._all) | {"final_obs": final, "_final_obs": mask, "final_info": final_info}
        return self._observe(self._all), rewards, dead, over, {**info, "_final_info": mask}

    # Observations and infos.

    def _observe(self, which: Numbers) -> Any:
        """The observations of all worlds; only those of `which` are updated."""
        if self._observation == TEXT:
            texts = [""] * self.num_envs if self._seen is None else list(self._seen)
            for number in which.tolist():
                texts[number] = self._tell(number)
            self._seen = tuple(texts)
            return self._seen
        if self._seen is None or (self._copy and len(which) == self.num_envs):
            # Every row is written, so nothing has to be copied.
            self._seen = np.zeros(self.observation_space.shape or (), self.observation_space.dtype)
        elif self._copy:
            self._seen = self._seen.copy()
        self._worlds.observe(self._observation, which, self._seen)
        return self._seen

    def _tell(self, number: int) -> str:
        action, sight = int(self._actions[number]), self._worlds.sight(number)
        dead = sight.inventory["health"] <= 0
        return describe(sight, None if action < 0 else action, dead=dead, corrected=self._corrected)

    def _info(self, which: Numbers) -> dict[str, Any]:
        """The infos of the worlds in `which`, as arrays with a row for every world."""
        mask = np.zeros(self.num_envs, np.bool_)
        mask[which] = True
        worlds = self._worlds
        info: dict[str, Any] = {
            "inventory": named(CARRIED, worlds.carried, mask),
            "achievements": named(ACHIEVEMENTS, worlds.achievements, mask),
            "discount": 1 - (worlds.health <= 0).astype(np.float64),
            "player_pos": worlds.positions,
            "reward": worlds.rewards.copy(),
        }
        if self._semantic:
            info["semantic"] = np.stack([worlds.semantic_map(number) for number in range(self.num_envs)])
        return info | {f"_{key}": mask for key in info}

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Return the pictures of all worlds, with `render_mode="rgb_array"`."""
        if self.render_mode is None:
            return None
        self._check_begun(range(self.num_envs))
        return tuple(draw(self._worlds.scene(number)) for number in range(self.num_envs))

    def state(self, number: int) -> Any:
        """The whole state of a world except its random stream, as JSON; the same as that of a single world."""
        return self._worlds.state(number)

    def fingerprint(self, number: int) -> bytes:
        """The state of a world's random stream."""
        return self._worlds.fingerprint(number)

    def close_extras(self, **kwargs: Any) -> None:
        """End the threads."""
        self._worlds.close()
