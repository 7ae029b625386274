"""Guide: a walker who is told a way to the goal. It measures whether a task can be done; players know nothing of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from smartplay_tools.games.minecraft.luanti.engine import LuantiEngine
from smartplay_tools.games.minecraft.tasks import ACTIONS

_WAYS = np.array([(0, -1), (1, 0), (0, 1), (-1, 0)])
"""x and z of each action's heading."""

_STUCK = 3
"""Who has come less than this many blocks forward in an action has met an obstacle."""

_ARRIVED = 6
"""Who is this near the end of the way without being in the goal looks around."""

_AROUND = 30


class Guide:
    """Chooses actions for an engine that has just been reset."""

    def __init__(self, engine: LuantiEngine, seed: int) -> None:
        self._engine, self._random = engine, np.random.default_rng(seed)
        self._way: NDArray[np.int64] = np.array(engine.way)
        self._failures = 0
        self._tried: tuple[NDArray[np.float64], int] | None = None

    def best_action(self) -> int:
        """Along the way; where that is blocked, the next best, and then anything."""
        here = np.array(self._engine.position)[[0, 2]]
        if self._tried is not None:
            before, action = self._tried
            self._failures = self._failures + 1 if (here - before) @ _WAYS[action] < _STUCK else 0
        order = np.argsort(-_WAYS @ (self._target(here) - here), kind="stable")
        action = int(order[self._failures] if self._failures < 2 else self._random.integers(len(ACTIONS)))
        self._tried = here, action
        return action

    def _target(self, here: NDArray[np.float64]) -> NDArray[np.int64]:
        """The place after the nearest one of the way."""
        nearest = int(np.abs(self._way - here).sum(axis=1).argmin())
        self._way = self._way[nearest:]
        if len(self._way) == 1 and np.abs(self._way[0] - here).max() < _ARRIVED:
            self._way = self._way + self._random.integers(-_AROUND, _AROUND + 1, 2)
        target: NDArray[np.int64] = self._way[min(1, len(self._way) - 1)]
        return target
