"""The speed of Crafter compared with PyPI `crafter`.

Run `python benchmarks/crafter_speed.py`; it takes about a minute. (A script named `crafter.py` would hide the package.)

Both play the same seeds with the same random actions, in turns within one run, so that other load on the machine slows
down both. Ours is the whole environment, including texts; PyPI's is its plain `Env`. Times are medians of rounds.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import crafter
import numpy as np
from rich.console import Console
from rich.table import Table

from smartplay_tools.games.specs import GAMES

ROUNDS = 7
STEPS = 600
"""The number of steps: two days with their nights."""


def seconds(action: Callable[[], object]) -> float:
    begin = time.perf_counter()
    action()
    return time.perf_counter() - begin


def mean_step(reset: Callable[[], object], step: Callable[[int], bool], actions: list[int]) -> float:
    """Seconds per step; resets after a death are not counted."""
    total = 0.0
    reset()
    for action in actions:
        begin = time.perf_counter()
        done = step(action)
        total += time.perf_counter() - begin
        if done:
            reset()
    return total / len(actions)


def pypi_round(seed: int, actions: list[int]) -> tuple[float, float]:
    env = crafter.Env(seed=seed)
    return seconds(env.reset), mean_step(env.reset, lambda action: env.step(action)[2], actions)


def our_round(seed: int, actions: list[int]) -> tuple[float, float, float]:
    game = GAMES["Crafter-v0"].make()
    resets = statistics.median(seconds(lambda: game.reset(seed=seed)) for _ in range(9))
    step = mean_step(lambda: game.reset(seed=seed), lambda action: game.step(action)[2], actions)
    return resets, step, seconds(game.state_hash)


def speed() -> Table:
    rng = np.random.default_rng(0)
    GAMES["Crafter-v0"].make().reset(seed=0)
    pypi, ours = [], []
    for seed in range(ROUNDS):
        actions = rng.integers(17, size=STEPS).tolist()
        pypi.append(pypi_round(seed, actions))
        ours.append(our_round(seed, actions))
    pypi_reset, pypi_step = (statistics.median(column) for column in zip(*pypi, strict=True))
    reset, step, state_hash = (statistics.median(column) for column in zip(*ours, strict=True))
    table = Table(title="Crafter", caption=f"medians of {ROUNDS} rounds of {STEPS} random steps")
    for column in ("engine", "reset (ms)", "step (us)", "with text", "state hash (us)"):
        table.add_column(column, justify="right")
    table.add_row("PyPI crafter", f"{pypi_reset * 1e3:.0f}", f"{pypi_step * 1e6:.0f}", "no", "-")
    table.add_row("fast", f"{reset * 1e3:.2f}", f"{step * 1e6:.1f}", "yes", f"{state_hash * 1e6:.0f}")
    table.add_row("ratio", f"x{pypi_reset / reset:.0f}", f"x{pypi_step / step:.0f}", "", "")
    return table


if __name__ == "__main__":
    Console().print(speed())
