"""Several worlds of Crafter as one object, for the environments for reinforcement learning.

`PlainWorlds` steps Python engines one after the other and has no dependencies. `compiled.worlds.CompiledWorlds` is
about thirteen times as fast with numba, and `make_worlds` prefers it where numba is installed.
"""

from __future__ import annotations

import importlib.util
import warnings
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from smartplay_tools.errors import InvalidArgumentError, check_choice
from smartplay_tools.games.crafter.facts import ACHIEVEMENTS, AREA
from smartplay_tools.games.crafter.fast import FastEngine
from smartplay_tools.games.crafter.observations import observe
from smartplay_tools.games.crafter.views import Scene, Sight
from smartplay_tools.games.crafter.world import position, without_margin

Numbers = NDArray[np.intp]
"""The indices of some of the worlds, each once."""

COMPILED, PLAIN = ENGINES = ("compiled", "fast")
SLOW = (
    "numba is not installed, so worlds are stepped by Python one after the other: a step takes about 13 times as long, "
    "a picture 5 times, a reset 8 times (benchmarks/crafter_vector.py). Install the extra: "
    "pip install 'smartplay-tools[rl]'; or ask for engine=\"fast\"."
)
"""The warning if the slow engine is used although it was not asked for."""


class Worlds(Protocol):
    """Worlds by number, from 0."""

    count: int
    rewards: NDArray[np.float64]
    """The reward of the last step of each world."""

    def begin(self, which: Numbers, seeds: Sequence[int], episodes: Sequence[int]) -> None:
        """Make new worlds, each for an episode (from 1) of a seed."""
        ...

    def step(self, which: Numbers, actions: NDArray[np.int64]) -> None:
        """Play an action in each world in `which`; `actions` has one for every world."""
        ...

    @property
    def steps(self) -> NDArray[np.int32]:
        """The steps of each world since it began."""
        ...

    @property
    def carried(self) -> NDArray[np.int32]:
        """Vitals and items of each player, health first."""
        ...

    @property
    def health(self) -> NDArray[np.int32]:
        """The health of each player; at 0 it is dead."""
        ...

    @property
    def achievements(self) -> NDArray[np.int32]:
        """How often each player reached each achievement, in the order of `facts.ACHIEVEMENTS`."""
        ...

    @property
    def positions(self) -> NDArray[np.int64]:
        """Where each player is, x and y."""
        ...

    def observe(self, observation: str, which: Numbers, out: NDArray[Any]) -> None:
        """Write an observation (other than text) of each world in `which` into its row of `out`."""
        ...

    def semantic_map(self, number: int) -> NDArray[np.uint8]:
        """The ids of a whole map, by x and y."""
        ...

    def sight(self, number: int) -> Sight:
        """The part of a world's state that the observation text describes."""
        ...

    def scene(self, number: int) -> Scene:
        """The part of a world's state that a picture shows."""
        ...

    def state(self, number: int) -> Any:
        """The whole state of a world except its random stream, as JSON."""
        ...

    def fingerprint(self, number: int) -> bytes:
        """The state of a world's random stream."""
        ...

    def close(self) -> None:
        """End the threads."""
        ...


def make_worlds(count: int, engine: str | None, *, threads: int = 1) -> Worlds:
    """Worlds of an engine; by default the compiled one if numba is installed, else the plain one, with a warning."""
    if engine is not None:
        check_choice("engine", engine, ENGINES)
    else:
        engine = COMPILED if importlib.util.find_spec("numba") else PLAIN
        if engine == PLAIN:
            warnings.warn(SLOW, stacklevel=3)
    if engine == PLAIN:
        return PlainWorlds(count)
    try:
        # Only this engine needs numba.
        from smartplay_tools.games.crafter.compiled.worlds import CompiledWorlds
    except ModuleNotFoundError as error:
        if error.name != "numba":
            raise
        raise InvalidArgumentError(
            "The compiled engine needs numba: pip install 'smartplay-tools[rl]', or take engine=\"fast\"."
        ) from error
    return CompiledWorlds(count, threads)


class PlainWorlds:
    """The implementation of `Worlds` in plain Python, which steps one world after the other."""

    def __init__(self, count: int) -> None:
        self.count = count
        self.rewards = np.zeros(count)
        self._engines: list[FastEngine | None] = [None] * count

    def close(self) -> None:
        """Do nothing, since there are no threads."""

    def begin(self, which: Numbers, seeds: Sequence[int], episodes: Sequence[int]) -> None:
        """Make new worlds."""
        for number, seed, episode in zip(which.tolist(), seeds, episodes, strict=True):
            self._engines[number] = FastEngine(seed, episode, keep_grain=True)

    def step(self, which: Numbers, actions: NDArray[np.int64]) -> None:
        """Play an action in each world in `which`."""
        for number in which.tolist():
            self.rewards[number] = self._engine(number).step(int(actions[number]))

    def _engine(self, number: int) -> FastEngine:
        engine = self._engines[number]
        assert engine is not None, "A world has to begin first."
        return engine

    def _all(self) -> list[FastEngine]:
        return [self._engine(number) for number in range(self.count)]

    @property
    def steps(self) -> NDArray[np.int32]:
        """The steps of each world since it began."""
        return np.array([engine.steps for engine in self._all()], np.int32)

    @property
    def carried(self) -> NDArray[np.int32]:
        """Vitals and items of each player."""
        return np.array([list(engine.player.inventory.values()) for engine in self._all()], np.int32)

    @property
    def health(self) -> NDArray[np.int32]:
        """The health of each player."""
        return np.array([engine.health for engine in self._all()], np.int32)

    @property
    def achievements(self) -> NDArray[np.int32]:
        """How often each player reached each achievement."""
        reached = [[engine.player.unlocked.get(name, 0) for name in ACHIEVEMENTS] for engine in self._all()]
        return np.array(reached, np.int32)

    @property
    def positions(self) -> NDArray[np.int64]:
        """Where each player is."""
        return np.array([position(engine.player.at) for engine in self._all()], np.int64)

    def observe(self, observation: str, which: Numbers, out: NDArray[Any]) -> None:
        """Write an observation of each world in `which` into its row of `out`."""
        for number in which.tolist():
            out[number] = observe(self._engine(number), observation)

    def semantic_map(self, number: int) -> NDArray[np.uint8]:
        """The ids of a whole map."""
        cells = np.frombuffer(without_margin(self._engine(number).world.surface), np.uint8)
        return cells.reshape(AREA, AREA)

    def sight(self, number: int) -> Sight:
        """The part of a world's state that the observation text describes."""
        return self._engine(number).sight()

    def scene(self, number: int) -> Scene:
        """The part of a world's state that a picture shows."""
        return self._engine(number).scene()

    def state(self, number: int) -> Any:
        """The whole state of a world except its random stream."""
        return self._engine(number).state()

    def fingerprint(self, number: int) -> bytes:
        """The state of a world's random stream."""
        return self._engine(number).fingerprint()
