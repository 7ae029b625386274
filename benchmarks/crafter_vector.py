"""The speed of many worlds of Crafter compared with PyPI `crafter`: steps, resets and pictures, by day and by night.

Run `python benchmarks/crafter_vector.py`; it takes some minutes, and needs the extra `rl` for the compiled rows. All
play random actions in turns within one run, on one core, so that other load on the machine slows down each. Times
are per world and in CPU time, medians of rounds. A step of ours is measured twice: the rules alone, and
`step` of the vector with an observation and Gymnasium's infos. PyPI's `Env` always draws its picture; its rules alone
are measured with the drawing taken out.
"""

from __future__ import annotations

import importlib.util
import statistics
import time
from collections.abc import Callable

import crafter
import gymnasium
import numpy as np
from rich.console import Console
from rich.table import Table

import smartplay_tools  # noqa: F401 - it registers the environments
from smartplay_tools.games.crafter.worlds import ENGINES, make_worlds

ID = "smartplay/Crafter-v0"
ROUNDS, WORLDS, STEPS, PACKAGE_STEPS = 5, 256, 300, 300
OBSERVATIONS = ("semantic", "symbolic", "image", "text")


def seconds(action: Callable[[], object]) -> float:
    begin = time.process_time()
    action()
    return time.process_time() - begin


def package_round(seed: int, rng: np.random.Generator) -> dict[str, float]:
    """PyPI's step with its picture, its reset, and its picture alone."""
    env = crafter.Env(seed=seed)
    resets, steps = [seconds(env.reset)], []
    for action in rng.integers(17, size=PACKAGE_STEPS):
        stepped: list[object] = []
        steps.append(seconds(lambda action=action, stepped=stepped: stepped.append(env.step(action))))
        if stepped[0][2]:
            resets.append(seconds(env.reset))
    pictures = [seconds(env.render) for _ in range(50)]
    return {"step and image": np.mean(steps), "reset": np.mean(resets), "image": np.mean(pictures)}


def rules_round(engine: str, seed: int, rng: np.random.Generator, worlds: int, steps: int) -> dict[str, float]:
    """Ours without Gymnasium: steps by day and by night, resets, and each observation."""
    made, every = make_worlds(worlds, engine), np.arange(worlds)
    played: dict[bool, list[float]] = {False: [], True: []}
    resets = [seconds(lambda: made.begin(every, [seed * 1000 + n for n in range(worlds)], [1] * worlds)) / worlds]
    for step in range(1, steps + 1):
        actions = rng.integers(17, size=worlds)
        played[bool(made.steps[0] % 300 >= 148)].append(
            seconds(lambda actions=actions: made.step(every, actions)) / worlds
        )
        dead = np.flatnonzero(made.health <= 0)
        # The first world is the oldest, so it determines the time of day.
        dead = dead[dead > 0]
        if len(dead):
            resets.append(
                seconds(lambda dead=dead, step=step: made.begin(dead, (dead + step).tolist(), [2] * len(dead)))
                / len(dead)
            )
    figures = {"day": statistics.median(played[False]), "night": statistics.median(played[True])}
    figures["step"] = np.mean(played[False] + played[True])
    figures["reset"] = np.mean(resets)
    for observation, shape, dtype in (
        ("semantic", (81,), np.uint8),
        ("symbolic", (1345,), np.float32),
        ("image", (64, 64, 3), np.uint8),
    ):
        out = np.zeros((worlds, *shape), dtype)
        figures[observation] = min(
            seconds(lambda observation=observation, out=out: made.observe(observation, every, out)) / worlds
            for _ in range(3)
        )
    return figures


def vector_round(engine: str, observation: str, rng: np.random.Generator, worlds: int, steps: int) -> float:
    """Ours as Gymnasium's vector, resets of ended episodes included."""
    vector = gymnasium.make_vec(ID, num_envs=worlds, observation=observation, engine=engine)
    vector.reset(seed=0)
    actions = rng.integers(17, size=(steps, worlds))
    return seconds(lambda: [vector.step(row) for row in actions]) / steps / worlds


def main() -> None:
    engines = [engine for engine in ENGINES if engine != "compiled" or importlib.util.find_spec("numba")]
    sizes = {"compiled": (WORLDS, STEPS), "fast": (8, STEPS)}
    rng = np.random.default_rng(0)
    for engine in engines:
        rules_round(engine, 0, rng, 2, 200)  # compile, and fill the tables
    package: list[dict[str, float]] = []
    ours: dict[str, list[dict[str, float]]] = {engine: [] for engine in engines}
    vectors: dict[tuple[str, str], list[float]] = {}
    for number in range(ROUNDS):
        package.append(package_round(number, rng))
        for engine in engines:
            ours[engine].append(rules_round(engine, number, rng, *sizes[engine]))
            for observation in OBSERVATIONS:
                spent = vector_round(engine, observation, rng, *sizes[engine])
                vectors.setdefault((engine, observation), []).append(spent)

    def median(rounds: list[dict[str, float]], key: str) -> float:
        return statistics.median(figures[key] for figures in rounds) * 1e6

    table = Table(
        title="Crafter, us per world on one core",
        caption=f"medians of {ROUNDS} rounds; compiled: {WORLDS} worlds, fast: {sizes['fast'][0]}",
    )
    for column in ("what", "PyPI crafter", *engines, *(f"PyPI / {engine}" for engine in engines)):
        table.add_column(column, justify="right")

    def row(what: str, theirs: float | None, times: list[float]) -> None:
        ratios = ["" if theirs is None else f"x{theirs / spent:,.0f}" for spent in times]
        table.add_row(what, "" if theirs is None else f"{theirs:,.0f}", *(f"{spent:,.2f}" for spent in times), *ratios)

    with_image, alone = median(package, "step and image"), median(package, "image")
    row("a step, the rules alone", with_image - alone, [median(ours[engine], "step") for engine in engines])
    row("  by day", None, [median(ours[engine], "day") for engine in engines])
    row("  by night", None, [median(ours[engine], "night") for engine in engines])
    row("a reset", median(package, "reset"), [median(ours[engine], "reset") for engine in engines])
    row("an image, 64 x 64, by night", alone, [median(ours[engine], "image") for engine in engines])
    for observation in ("semantic", "symbolic"):
        row(f"a {observation} observation", None, [median(ours[engine], observation) for engine in engines])
    for observation in OBSERVATIONS:
        theirs = with_image if observation == "image" else None
        spent = [statistics.median(vectors[engine, observation]) * 1e6 for engine in engines]
        row(f"vector.step with {observation}, resets included", theirs, spent)
    Console(width=120).print(table)


if __name__ == "__main__":
    main()
