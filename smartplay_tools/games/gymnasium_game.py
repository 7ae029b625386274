"""GymnasiumGame: a text game around any Gymnasium environment whose actions can be named.

A subclass says in words what the environment shows, and names its actions; everything else follows from Gymnasium's
interface. The environment need not be written for it. Its state need not be readable: seed and actions decide an
episode, so the game's state is their digest, and a copy plays the same actions again. It may draw from the global
streams of `random` and `numpy.random`: each game keeps two streams, which are in place only while its environment runs.
"""

from __future__ import annotations

import hashlib
import itertools
import math
import random
import threading
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from enum import Enum
from numbers import Number
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces

from smartplay_tools.errors import GameValueError, InvalidArgumentError
from smartplay_tools.games import values
from smartplay_tools.games.base import TextGame, with_action_list

MOST_ACTIONS = 256
"""The most actions that are listed by name in a manual and in the description of a tool."""

SEEDS = 2**31
"""The seeds of environments are below this number, which every environment accepts."""


class GymnasiumGame(TextGame):
    """A text game around a Gymnasium environment.

    A subclass defines `make_env`, `describe`, `actions` and `manual`; each may also be an argument. `actions` are the
    names of the environment's actions, in their order: texts, members of an `Enum`, or numbers. Where an action has
    several parts (`MultiDiscrete`, `MultiBinary`, a `Tuple` or `Dict` of lists of choices), it is a sequence of names
    for each part, and every combination is an action. For other spaces define `action_of`. `manual` is the text without
    the list of actions, which is appended.

    The score is the sum of the rewards, and an episode is completed when the environment terminates it with a positive
    last reward. A subclass that scores differently sets both in its `_step`, after that of this class.

    Attributes:
        env: the environment.
        env_observation: what its latest `reset` or `step` returned as observation.
        env_info: what it returned as info.
        uses_global_streams: whether the environment may draw from `random` or `numpy.random`; a subclass whose
            environment draws from its own generator alone sets it to False, and saves half a step's overhead.
    """

    uses_global_streams: ClassVar[bool] = True

    def __init__(
        self,
        *,
        make_env: Callable[[], gymnasium.Env[Any, Any]] | None = None,
        describe: Callable[[Any, dict[str, Any]], str] | None = None,
        actions: Sequence[Any] | None = None,
        action_of: Callable[[str], Any] | None = None,
        manual: str | None = None,
        **options: Any,
    ) -> None:
        given = {
            "make_env": make_env, "describe": describe, "actions": actions, "action_of": action_of, "manual": manual
        }  # fmt: skip
        self.__dict__.update({name: value for name, value in given.items() if value is not None})
        for name in ("actions", "manual"):
            if not getattr(self, name, None):
                raise self._without(name)
        self.actions = _combined(self.actions)
        self.manual = with_action_list(self.manual, self.actions)
        super().__init__(**options)
        self._streams: AbstractContextManager[None]
        self._env_seed: int | None = None
        self._played: list[int] = []
        self._digest = b""
        self._begin()
        self._env_actions: list[Any] = []
        if getattr(self.env, "action_space", None) is not None:
            self._find_actions()

    # What a subclass defines.

    def make_env(self) -> gymnasium.Env[Any, Any]:
        """Return a new environment."""
        raise self._without("make_env")

    def describe(self, observation: Any, info: dict[str, Any]) -> str:
        """Return what the player reads, from what the environment's `reset` or `step` returned."""
        raise self._without("describe")

    def action_of(self, name: str) -> Any:
        """Return the environment's action of that name."""
        return self._actions_by_name()[name]

    # What follows from it.

    def _reset(self) -> str:
        self._env_seed, self._played, self._digest = int(self.np_random.integers(SEEDS)), [], b""
        self._begin(self._env_seed)
        if not self._env_actions:  # its environment makes the space of its actions in a reset
            self._find_actions()
        return self._text()

    def _find_actions(self) -> None:
        self._env_actions = [self.action_of(name) for name in self.actions]

    def _step(self, action: int) -> tuple[str, float, bool, bool]:
        reward, terminated, truncated = self._play(action)
        self._played.append(action)
        self.score += reward
        self.completed = terminated and reward > 0
        return self._text(), reward, terminated, truncated

    def _state(self) -> bytes:
        """A digest of the seed, the actions and the texts: together they decide the future of the environment."""
        return self._digest

    def close(self) -> None:
        """Close the environment."""
        with self._streams:
            self.env.close()

    def __getstate__(self) -> dict[str, Any]:
        """A copy or pickle makes its own environment and plays the episode again: not every environment is copied."""
        remade = ("env", "env_observation", "env_info", "_streams")
        return {name: value for name, value in vars(self).items() if name not in remade}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._begin(self._env_seed)
        for action in self._played:
            self._play(action)

    def _begin(self, seed: int | None = None) -> None:
        """Make the environment, unless it is there, and reset it with a seed, if there is one."""
        self._streams = _GlobalStreams(seed or 0) if self.uses_global_streams else nullcontext()
        with self._streams:
            if "env" not in vars(self):
                self.env = self.make_env()
            if seed is not None:
                self.env_observation, self.env_info = _reset(self.env, seed)

    def _play(self, action: int) -> tuple[float, bool, bool]:
        with self._streams:
            given = self.env.step(self._env_actions[action])
        if not isinstance(given, tuple | list) or len(given) != 5:
            count = len(given) if isinstance(given, tuple | list) else 1
            raise _not_gymnasium(self.env, f"step returns {count} values instead of 5")
        step = self._steps + 1
        self.env_observation, reward, terminated, truncated, self.env_info = given
        return (
            float(_one_reward(reward, step)),
            values.flag("`terminated`", terminated, step),
            values.flag("`truncated`", truncated, step),
        )

    def _text(self) -> str:
        """Return the text of the current observation, and add it to the digest."""
        said = self.describe(self.env_observation, self.env_info)
        text = values.text("What `describe` says", said, len(self._played))
        seen = f"{self._env_seed} {self._played[-1:]} {text}".encode()
        self._digest = hashlib.blake2b(self._digest + seen, digest_size=16).digest()
        return text

    def _actions_by_name(self) -> dict[str, Any]:
        """Return the environment's actions by their names."""
        space = self.env.action_space
        parts = _parts(space)
        if not parts:
            raise InvalidArgumentError(
                f"The actions of {type(self).__name__} are {space}, which is not a list of choices: define "
                "action_of(name), which returns the environment's action of each name in actions."
            )
        count = math.prod(map(len, parts))
        if count != len(self.actions):
            raise InvalidArgumentError(
                f"{type(self).__name__} names {len(self.actions)} actions, and its environment has {count}: name each "
                "in actions, or define action_of(name)."
            )
        combined = (_joined(space, iter(choice)) for choice in itertools.product(*parts))
        return dict(zip(self.actions, combined, strict=True))

    def _without(self, name: str) -> InvalidArgumentError:
        return InvalidArgumentError(
            f"{type(self).__name__} has no {name}: a game around a Gymnasium environment defines make_env, describe, "
            "actions and manual."
        )


def _combined(names: Sequence[Any]) -> tuple[str, ...]:
    """Return the names of actions; of actions with several parts, given as a sequence each, every combination."""
    parts: list[list[str | None]] = [[_name(each) for each in names]]
    if None in parts[0]:
        parts = [[_name(each) for each in part] for part in names if _name(part) is None and isinstance(part, Iterable)]
        if len(parts) != len(names) or any(None in part for part in parts):
            raise InvalidArgumentError(
                f"actions are names, which are texts, members of an Enum or numbers, or a sequence of names for each "
                f"part of an action, and not {names!r}."
            )
    if (count := math.prod(map(len, parts))) > MOST_ACTIONS:
        raise InvalidArgumentError(
            f"{count:,} actions cannot be listed by name, only up to {MOST_ACTIONS}: name fewer in actions, and define "
            "action_of(name)."
        )
    return tuple(", ".join(map(str, choice)) for choice in itertools.product(*parts))


def _name(given: Any) -> str | None:
    """Return the name of an action as a text; None if it is none."""
    if isinstance(given, str):
        return str.__str__(given)
    if isinstance(given, Enum):
        return given.name
    return str(given) if isinstance(given, Number) else None


def _reset(env: gymnasium.Env[Any, Any], seed: int) -> tuple[Any, Any]:
    """Reset an environment with a seed; return observation and info."""
    try:
        given: Any = env.reset(seed=seed)
    except TypeError as error:
        if "'seed'" not in str(error):
            raise
        raise _not_gymnasium(env, "reset takes no seed") from error
    if isinstance(given, tuple | list) and len(given) == 2 and isinstance(given[1], Mapping):
        return given[0], given[1]
    raise _not_gymnasium(env, "reset does not return an observation and an info")


def _not_gymnasium(env: gymnasium.Env[Any, Any], why: str) -> InvalidArgumentError:
    """Return the error about an environment that has the interface of another library."""
    return InvalidArgumentError(
        f"{type(getattr(env, 'unwrapped', env)).__name__} is no Gymnasium environment, since its {why}: wrap one of "
        "Gym 0.21 in shimmy.GymV21CompatibilityV0, and one that returns a cost, too, in "
        "safety_gymnasium.wrappers.SafetyGymnasium2Gymnasium."
    )


def _one_reward(reward: Any, step: int) -> int | float:
    """Return the reward of a step, which is one number."""
    try:
        return values.number("The reward", reward, step)
    except GameValueError:
        if isinstance(reward, str) or not isinstance(reward, Collection):
            raise
        raise InvalidArgumentError(
            f"The reward of step {step} is of the type {type(reward).__name__}, with {len(reward)} parts, and not one "
            "number: wrap an environment with several objectives in mo_gymnasium.wrappers.LinearReward, and one with "
            "several agents in gymnasium.wrappers.TransformReward(env, sum)."
        ) from None


def _parts(space: spaces.Space[Any]) -> list[range] | None:
    """Return the numbers of each part of an action; None if the space is not a list of choices."""
    match space:
        case spaces.Discrete():
            return [range(int(space.start), int(space.start + space.n))]
        case spaces.MultiDiscrete():
            pairs = zip(space.start.flat, space.nvec.flat, strict=True)
            return [range(int(start), int(start + count)) for start, count in pairs]
        case spaces.MultiBinary():
            return [range(2)] * math.prod(space.shape)
        case spaces.Tuple() | spaces.Dict():
            found = [_parts(part) for part in (space.values() if isinstance(space, spaces.Dict) else space)]
            whole = [part for part in found if part is not None]
            return list(itertools.chain(*whole)) if len(whole) == len(found) else None
    return None


def _joined(space: spaces.Space[Any], choice: Iterator[int]) -> Any:
    """Return the action of a space from the numbers of its parts."""
    match space:
        case spaces.Tuple():
            return tuple(_joined(part, choice) for part in space)
        case spaces.Dict():
            return {name: _joined(part, choice) for name, part in space.items()}
        case spaces.MultiDiscrete() | spaces.MultiBinary():
            count = math.prod(space.shape)
            return np.array(list(itertools.islice(choice, count)), space.dtype).reshape(space.shape)
    return next(choice)


_IN_USE = threading.RLock()
"""Held while the global streams are those of a game."""

_NUMPY: Any = np.random  # its stubs lack two of its functions


class _GlobalStreams:
    """The streams of `random` and `numpy.random` as one environment sees them; `with` puts them in place.

    NumPy's legacy functions keep the second of two normal numbers outside of the bit generator, and lose it when the
    bit generator is replaced, so the program's is put back.
    """

    def __init__(self, seed: int) -> None:
        self._python = random.Random(seed).getstate()
        self._numpy = np.random.MT19937(seed)

    def __enter__(self) -> None:
        _IN_USE.acquire()
        self._outside = random.getstate(), _NUMPY.get_bit_generator(), np.random.get_state(legacy=False)
        random.setstate(self._python)
        _NUMPY.set_bit_generator(self._numpy)

    def __exit__(self, *_: object) -> None:
        self._python = random.getstate()
        python, bits, state = self._outside
        random.setstate(python)
        _NUMPY.set_bit_generator(bits)
        if state["has_gauss"]:
            np.random.set_state(state)
        _IN_USE.release()
