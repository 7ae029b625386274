"""Mean scores of the random and the rule player, setting by setting. `python benchmarks/scores.py [EPISODES]`."""

from __future__ import annotations

import statistics
import sys

from rich.console import Console
from rich.table import Table

import smartplay_tools as sp


def mean_score(game: str, player: str, episodes: int) -> float:
    """The mean over the seeds 0, 1, ...; episode and player share the seed."""
    scores = []
    for seed in range(episodes):
        with sp.Episode(game, seed=seed) as episode:
            scores.append(sp.play(episode, sp.get_player(player, seed=seed)).score)
    return statistics.mean(scores)


if __name__ == "__main__":
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    table = Table("setting", "random", "rule", title=f"Mean score over {count} seeds", title_justify="left")
    for name in sp.GAMES:
        table.add_row(name, *(f"{mean_score(name, player, count):.1f}" for player in ("random", "rule")))
    Console().print(table)
