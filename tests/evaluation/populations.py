"""What simulations of statistics draw from: scores of our own players."""

from __future__ import annotations

from typing import Any

import numpy as np

import smartplay_tools as sp
from smartplay_tools.evaluation.analysis import by_cell

BANDIT, RPS, HANOI, MESSENGER = (
    "BanditTwoArmedHighLowFixed-v0",
    "RockPaperScissorBasic-v0",
    "Hanoi3Disk-v0",
    "MessengerL1-v0",
)


def play(folder: Any) -> dict[Any, Any]:
    """The rows of 200 episodes of our own players, by game, player and history."""
    rows = []
    for history, games in ((0, [MESSENGER]), (3, [MESSENGER]), (10, [BANDIT, RPS]), (50, [BANDIT, RPS, HANOI])):
        budget = sp.Budget(history=history)
        rows += sp.evaluate(games, ["random", "rule"], budgets=budget, trials=200, out=folder / str(history)).rows
    return {(cell.game, cell.player, cell.budget["history"]): members for cell, members in by_cell(rows)}


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
