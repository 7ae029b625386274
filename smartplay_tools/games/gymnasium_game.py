"""GymnasiumGame: a text game around any Gymnasium environment whose actions can be named.

A subclass says in words what the environment shows, and names its actions; everything else follows from Gymnasium's
interface. The environment need not be written for it. Its state need not be readable: seed and actions decide an
episode, so the game's state is their digest, and a copy plays the same actions again. It may draw from the global
streams of `random` and `numpy.random`: each game keeps two streams, which are in place only while its environment runs.
"""

from __future__ import annotations

import ctypes
import hashlib
import itertools
import math
import random
import threading
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.games.base import TextGame, with_action_list

MOST_ACTIONS = 256
"""The most actions that are listed by name in a manual and in the description of a tool."""

SEEDS = 2**31
"""The seeds of environments are below this number, which every environment accepts."""


class GymnasiumGame(TextGame):
    """A text game around a Gymnasium environment.

    A subclass defines `make_env`, `describe`, `actions` and `manual`; each may also be an argument. `actions` are the
    names of the environment's actions, in their order. Where an action has several parts (`Tuple` of `Discrete`,
    `MultiDiscrete`), it is a sequence of names for each part, and every combination is an action. For other spaces
    define `action_of`. `manual` is the text without the list of actions, which is appended.

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
        self._env_actions = [self.action_of(name) for name in self.actions]

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
        return self._text()

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
                self.env_observation, self.env_info = self.env.reset(seed=seed)

    def _play(self, action: int) -> tuple[float, bool, bool]:
        with self._streams:
            step = self.env.step(self._env_actions[action])
        self.env_observation, reward, terminated, truncated, self.env_info = step
        return float(reward), bool(terminated), bool(truncated)

    def _text(self) -> str:
        """Return the text of the current observation, and add it to the digest."""
        text = self.describe(self.env_observation, self.env_info)
        if not isinstance(text, str):
            raise TypeError(f"{type(self).__name__}.describe must return a text, not {type(text).__name__}.")
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
        return dict(zip(self.actions, (_joined(space, choice) for choice in itertools.product(*parts)), strict=True))

    def _without(self, name: str) -> InvalidArgumentError:
        return InvalidArgumentError(
            f"{type(self).__name__} has no {name}: a game around a Gymnasium environment defines make_env, describe, "
            "actions and manual."
        )


def _combined(names: Sequence[Any]) -> tuple[str, ...]:
    """Return the names of actions; of actions with several parts, given as a sequence each, every combination."""
    parts = [names] if all(isinstance(name, str) for name in names) else names
    if (count := math.prod(map(len, parts))) > MOST_ACTIONS:
        raise InvalidArgumentError(
            f"{count:,} actions cannot be listed by name, only up to {MOST_ACTIONS}: name fewer in actions, and define "
            "action_of(name)."
        )
    return tuple(", ".join(choice) for choice in itertools.product(*parts))


def _parts(space: spaces.Space[Any]) -> list[range]:
    """Return the numbers of each part of an action; none if the space is not a list of choices."""
    match space:
        case spaces.Discrete():
            return [range(int(space.start), int(space.start + space.n))]
        case spaces.MultiDiscrete():
            pairs = zip(space.start.flat, space.nvec.flat, strict=True)
            return [range(int(start), int(start + count)) for start, count in pairs]
        case spaces.Tuple() if all(isinstance(part, spaces.Discrete) for part in space):
            return [numbers for part in space for numbers in _parts(part)]
    return []


def _joined(space: spaces.Space[Any], choice: tuple[int, ...]) -> Any:
    """Return the action of a space from the number of each part."""
    match space:
        case spaces.Discrete():
            return choice[0]
        case spaces.MultiDiscrete():
            return np.array(choice, space.dtype).reshape(space.shape)
    return choice


_IN_USE = threading.RLock()
"""Held while the global streams are those of a game."""

_NUMPY: Any = np.random  # its stubs lack two of its functions
_PYTHON: Any = random.random.__self__  # type: ignore[attr-defined]
_PYTHON_STATE = (ctypes.c_void_p.from_buffer(ctypes.py_object(_PYTHON)).value or 0) + object.__basicsize__
"""Where the state of Python's stream is in memory: after the head of its object."""

_TWISTER_BYTES = 625 * 4
"""The size of the state of a Mersenne Twister in memory, Python's and NumPy's alike: 624 words and a position."""

_Seen = tuple[bytes, float | None, Any, bytes]


class _GlobalStreams:
    """The streams of `random` and `numpy.random` as one environment sees them; `with` puts them in place.

    Asking Python and NumPy for a state takes longer than most steps, so they are asked only where their memory is not
    as it was put in place last. NumPy's legacy functions keep the second of two normal numbers outside of the bit
    generator, and lose it when the bit generator is replaced: while the program has one, its state is always asked for.
    """

    put_back: ClassVar[tuple[_Seen, tuple[Any, Any, dict[str, Any]]] | None] = None
    """How the streams of the program looked when they were put back last, and their states; None where that is no
    sign that they have not been used."""

    def __init__(self, seed: int) -> None:
        self._python = random.Random(seed).getstate()
        self._numpy = np.random.MT19937(seed)

    def __enter__(self) -> None:
        _IN_USE.acquire()
        if (put_back := _GlobalStreams.put_back) is not None and put_back[0] == _seen():
            self._outside = put_back[1]
        else:
            bits = _NUMPY.get_bit_generator()
            self._outside = random.getstate(), bits, np.random.get_state(legacy=False)
        random.setstate(self._python)
        _NUMPY.set_bit_generator(self._numpy)
        self._inside = _python_memory()

    def __exit__(self, *_: object) -> None:
        if _python_memory() != self._inside:
            self._python = random.getstate()
        python, bits, state = self._outside
        random.setstate(python)
        _NUMPY.set_bit_generator(bits)
        if state["has_gauss"]:
            np.random.set_state(state)
        can_be_seen = isinstance(bits, np.random.MT19937) and not state["has_gauss"]
        _GlobalStreams.put_back = (_seen(), self._outside) if can_be_seen else None
        _IN_USE.release()


def _seen() -> _Seen:
    """Return the program's streams as they are in memory; of another bit generator than NumPy's usual one, nothing."""
    bits = _NUMPY.get_bit_generator()
    is_twister = isinstance(bits, np.random.MT19937)
    return (*_python_memory(), bits, ctypes.string_at(bits.ctypes.state_address, _TWISTER_BYTES) if is_twister else b"")


def _python_memory() -> tuple[bytes, float | None]:
    """Return the stream of `random` as it is in memory, and its second normal number."""
    return ctypes.string_at(_PYTHON_STATE, _TWISTER_BYTES), _PYTHON.gauss_next
