"""Episodes of the small games as the original played them, and our games brought to draw what it drew."""

from __future__ import annotations

import json
from collections.abc import Iterable
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from smartplay_tools.games.base import TextGame

Rows = list[dict[str, Any]]

ROWS: Rows = [
    json.loads(line)
    for line in (Path(__file__).parents[1] / "data" / "small_games.jsonl").read_text(encoding="utf-8").splitlines()
]
MANUALS = {row["game"]: row["manual_sha256"] for row in ROWS if "manual_sha256" in row}
"""Setting to the sha256 of its manual."""


def episodes(prefix: str = "") -> list[tuple[str, Rows]]:
    """The setting and the rows of each episode, the reset first, of the settings whose names begin so."""
    rows = (row for row in ROWS if row["game"].startswith(prefix))
    by_episode = groupby(rows, key=lambda row: (row["game"], row["episode"]))
    return [(game, list(episode)) for (game, _), episode in by_episode]


class Draws(np.random.Generator):
    """A random stream with given draws."""

    def __init__(self, draws: Iterable[float]) -> None:
        super().__init__(np.random.PCG64(0))
        self._draws = iter(draws)

    def random(self) -> float:  # type: ignore[override]
        return next(self._draws)


def begin(game: TextGame, rows: Rows) -> str:
    """Reset a game to an episode's deal and draws; return the first observation."""
    for seed in range(100):
        first, _ = game.reset(seed=seed)
        if _is_dealt(game, rows[1]):
            break
    game.np_random = Draws(_draw(row) for row in rows[1:])
    return first


def _is_dealt(game: TextGame, row: dict[str, Any]) -> bool:
    if "probs" in row:
        return list(game._table.probabilities) == row["probs"]
    return row.get("optimal") in (None, game.actions[game.optimal_action or 0])


def _draw(row: dict[str, Any]) -> float:
    if "probs" not in row:
        return 0.0 if row["reward"] > 0 else 0.999
    rock, paper, _ = row["probs"]
    middles = {"Rock": rock / 2, "Paper": rock + paper / 2, "Scissor": (rock + paper + 1) / 2}
    return middles[row["obs"].split("opponent chose ")[1].split(".")[0]]
