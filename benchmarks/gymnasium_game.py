"""What `GymnasiumGame` adds to a step of its environment. `python benchmarks/gymnasium_game.py`.

The environment's own step is measured in the same loop, step by step, so that both see the same machine; figures are
medians. Most of what is added goes when the environment is known not to draw from the global random streams.
"""

from __future__ import annotations

import itertools
import statistics
import time
from typing import Any

import gymnasium
from rich.console import Console
from rich.table import Table

from smartplay_tools.games import GymnasiumGame

STEPS, EPISODE = 5_000, 100


class Lake(GymnasiumGame):
    """Frozen Lake in words."""

    actions = ("Go left", "Go down", "Go right", "Go up")
    manual = "Cross the frozen lake."

    def make_env(self) -> gymnasium.Env[Any, Any]:
        """Return the environment without wrappers."""
        return gymnasium.make("FrozenLake-v1", is_slippery=False).unwrapped

    def describe(self, observation: Any, info: dict[str, Any]) -> str:
        """Return where the player is."""
        return f"You are on square {observation}."


class OwnGenerator(Lake):
    """Frozen Lake, which draws from its own generator alone."""

    uses_global_streams = False


def seconds(call: Any, *given: Any) -> float:
    """The time of one call."""
    start = time.perf_counter()
    call(*given)
    return time.perf_counter() - start


def medians() -> dict[str, float]:
    """Microseconds of a step, by what takes it."""
    env, game, own = Lake(history=0).env, Lake(history=0), OwnGenerator(history=0)
    steps = {"env.step": env.step, "GymnasiumGame.advance": game.advance, "without global streams": own.advance}
    times: dict[str, list[float]] = {name: [] for name in steps}
    for _ in range(STEPS // EPISODE):
        for each in (env, game, own):
            each.reset(seed=0)
        for name, step in itertools.chain.from_iterable(itertools.repeat(tuple(steps.items()), EPISODE)):
            times[name].append(seconds(step, 0))  # left, where the edge is: the episode goes on
    return {name: statistics.median(values) * 1e6 for name, values in times.items()}


if __name__ == "__main__":
    table = Table("part", "µs", "added", "beside env.step", title="A step of Frozen Lake", title_justify="left")
    measured = medians()
    for part, median in measured.items():
        added = median - measured["env.step"]
        table.add_row(part, f"{median:,.1f}", f"{added:,.1f}", f"{median / measured['env.step']:.1f}")
    Console().print(table)
