"""What simulations of statistics draw from: the scores of 200 episodes of our own players.

python -m tests.evaluation.populations     # plays them again, and writes them; minutes
"""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import smartplay_tools as sp
from smartplay_tools.evaluation.analysis import pairs
from smartplay_tools.evaluation.analysis.grouping import by_cell
from smartplay_tools.games.specs import GAMES
from smartplay_tools.statistics.distributions import Values
from smartplay_tools.statistics.intervals import Bounds

BANDIT, RPS, HANOI, MESSENGER = (
    "BanditTwoArmedHighLowFixed-v0",
    "RockPaperScissorBasic-v0",
    "Hanoi3Disk-v0",
    "MessengerL1-v0",
)
EPISODES = 200
HISTORIES = {0: (MESSENGER,), 3: (MESSENGER,), 10: (BANDIT, RPS), 50: (BANDIT, RPS, HANOI)}
"""The games that are played with this many past steps."""

PATH = Path(__file__).parents[1] / "data" / "population_scores.json"

Cell = tuple[str, str, int]
"""A game, a player, and its past steps."""


def play(folder: Path, history: int, trials: int = EPISODES, executor: str = "auto") -> dict[Cell, list[float]]:
    """The scores of the players with this many past steps, by trial."""
    run = sp.evaluate(
        list(HISTORIES[history]),
        ["random", "rule"],
        budgets=sp.Budget(history=history),
        trials=trials,
        out=folder / str(history),
        executor=executor,
    )
    return {
        (cell.game, cell.player or "", history): [row["score"] for row in sorted(rows, key=lambda row: row["trial"])]
        for cell, rows in by_cell(run.rows)
    }


def scores() -> dict[Cell, Values]:
    """The scores of all cells; those of one trial are of the same world."""
    written = json.loads(PATH.read_text(encoding="utf-8"))
    return {(each["game"], each["player"], each["history"]): np.array(each["scores"], dtype=float) for each in written}


def bounds(game: str) -> Bounds:
    """What a score of the game can be."""
    declared = pairs.bounds_of(pairs.score, GAMES[game])
    assert declared is not None
    return declared


def shuffled_differences(values: Values) -> Values:
    """Differences of two players that score alike and have nothing to do with each other."""
    return np.random.default_rng(1).permutation(values) - values


def tilted(values: Any, mean: float) -> Any:
    """Weights with which the values have that mean, and the same support."""
    values = np.asarray(values, dtype=float)
    scaled = (values - values.mean()) / values.std()
    low, high = -200.0, 200.0
    for _ in range(200):
        middle = (low + high) / 2
        weights = np.exp(middle * scaled - (middle * scaled).max())
        weights /= weights.sum()
        low, high = (middle, high) if weights @ values < mean else (low, middle)
    return weights


def main() -> None:
    """Play all episodes and write their scores."""
    with tempfile.TemporaryDirectory() as folder:
        cells = {cell: own for history in HISTORIES for cell, own in play(Path(folder), history).items()}
    lines = [
        json.dumps({"game": game, "player": player, "history": history, "scores": own})
        for (game, player, history), own in cells.items()
    ]
    PATH.write_text("[\n" + ",\n".join(lines) + "\n]\n", encoding="utf-8")


if __name__ == "__main__":
    main()
