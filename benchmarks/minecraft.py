"""Time, memory and success rates of Minecraft's embedded engine: `python benchmarks/minecraft.py [N]`.

The guide, a path finder that knows the map, has 150 actions; the players `rule` and `random`, which see what a model
sees, have 200. Times are processor time. Memory is the increase of a process that has imported everything.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

import smartplay_tools as sp
from smartplay_tools.games.base import TextGame
from smartplay_tools.games.minecraft.rules import CORRECTED_GOALS
from smartplay_tools.games.minecraft.text import describe
from smartplay_tools.games.minecraft.voxel.climate import biomes, climate

sys.path.append(str(Path(__file__).parents[1]))  # the guides belong to the tests
from tests.guides.voxel import Guide

_GUIDE_STEPS = 150
_MEASURED_STEPS = 60


def milliseconds(times: list[float]) -> tuple[str, str, str]:
    ordered = [t * 1e3 for t in sorted(times)]
    return f"{statistics.median(ordered):.1f}", f"{ordered[int(len(ordered) * 0.9)]:.1f}", f"{ordered[-1]:.1f}"


def timed(call: Callable[[], object], times: list[float]) -> None:
    start = time.process_time()
    call()
    times.append(time.process_time() - start)


def speed() -> Table:
    resets: list[float] = []
    steps: list[float] = []
    texts: list[float] = []
    for task in CORRECTED_GOALS:
        game = sp.GAMES[f"MinedojoCreative{task}-v0"].make()
        game.reset(seed=0)
        random = np.random.default_rng(task)
        for seed in range(1, 6):
            timed(lambda game=game, seed=seed: game.reset(seed=seed), resets)
            for _ in range(_MEASURED_STEPS):
                action = int(random.integers(4))
                timed(lambda game=game, action=action: game.step(action), steps)
                timed(lambda game=game: describe(game._seen, "corrected"), texts)
                if game.completed:
                    game.reset()
        game.close()
    table = Table("", "median", "p90", "max", title="milliseconds of processor time", title_justify="left")
    table.add_row("new world and start", *milliseconds(resets))
    table.add_row("step, text included", *milliseconds(steps))
    table.add_row("of it the text", *milliseconds(texts))
    return table


_PROBE = """
import numpy as np, smartplay_tools as sp
import smartplay_tools.games.minecraft.game, smartplay_tools.games.minecraft.voxel.engine
def resident():
    with open("/proc/self/status") as status:
        return next(int(line.split()[1]) / 1024 for line in status if line.startswith("VmRSS"))
before = resident()
game = sp.GAMES["MinedojoCreative5-v0"].make()
game.reset(seed=0)
random = np.random.default_rng(0)
for _ in range(200):
    if game.step(int(random.integers(4)))[2]:
        game.reset()
print(resident() - before)
"""


def memory() -> float:
    """MiB that an environment has added to a process after 200 steps (Linux)."""
    shown = subprocess.run([sys.executable, "-c", _PROBE], capture_output=True, text=True, check=True)
    return float(shown.stdout)


def distance_to_goal(game: TextGame, goals: frozenset[int]) -> float:
    x, _, z = game.world.position
    axis = np.arange(-120, 121) * 8
    indices = np.nonzero(
        np.isin(biomes(climate(game.world.world.seed, int(x) + axis[:, None], int(z) + axis)), list(goals))
    )
    return float(np.hypot(axis[indices[0]], axis[indices[1]]).min())


def guided(task: int, seeds: int) -> tuple[list[float], list[int]]:
    """Distances from start to goal, and the numbers of actions in which the guide got there."""
    goals = CORRECTED_GOALS[task].biomes
    game = sp.GAMES[f"MinedojoCreative{task}-v0"].make()
    distances, needed = [], []
    for seed in range(seeds):
        game.reset(seed=seed)
        distances.append(distance_to_goal(game, goals))
        guide = Guide(game.world, goals)
        for step in range(1, _GUIDE_STEPS + 1):
            game.step(guide.best_action())
            if game.completed:
                needed.append(step)
                break
    game.close()
    return distances, needed


def completion(task: int, player: str, seeds: int) -> float:
    won = 0
    for seed in range(seeds):
        with sp.Episode(f"MinedojoCreative{task}-v0", seed=seed) as episode:
            won += sp.play(episode, sp.get_player(player, seed=seed)).completed
    return won / seeds


def players(seeds: int) -> Table:
    columns = ("task", "median distance", "guide", "median actions", "rule", "random")
    table = Table(*columns, title=f"who finds it, {seeds} seeds", title_justify="left")
    means = []
    for task, goal in CORRECTED_GOALS.items():
        distances, needed = guided(task, seeds)
        shares = [len(needed) / seeds, *(completion(task, player, seeds) for player in ("rule", "random"))]
        means.append(shares)
        shown = [f"{share:.0%}" for share in shares]
        actions = f"{statistics.median(needed):.0f}" if needed else ""
        table.add_row(f"{task} {goal.name}", f"{statistics.median(distances):.0f}", shown[0], actions, *shown[1:])
    overall = [f"{share:.0%}" for share in np.mean(means, axis=0)]
    table.add_row("mean", "", overall[0], "", *overall[1:])
    return table


if __name__ == "__main__":
    console = Console()
    console.print(speed())
    console.print(f"Memory of an environment after 200 steps: {memory():.0f} MiB\n")
    console.print(players(int(sys.argv[1]) if len(sys.argv) > 1 else 20))
