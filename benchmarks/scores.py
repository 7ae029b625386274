"""Mean scores of the random, the rule and the blind player, setting by setting.

`python benchmarks/scores.py [SEEDS [GAME ...]]`; without games, all of them. The blind player replays the best of the
rule player's episodes on other seeds.
"""

from __future__ import annotations

import statistics
import sys
import tempfile
from pathlib import Path

from rich.console import Console
from rich.table import Table

import smartplay_tools as sp


def mean_score(game: str, player: str, episodes: int, records: Path | None = None) -> float:
    """The mean over the seeds 0, 1, ...; episode and player share the seed. Records go into the folder, if given."""
    scores = []
    for seed in range(episodes):
        record = None if records is None else records / f"{seed}.jsonl"
        with sp.Episode(game, seed=seed, transcript=record) as episode:
            scores.append(sp.play(episode, sp.get_player(player, seed=seed)).score)
    return statistics.mean(scores)


def mean_scores(game: str, episodes: int) -> tuple[float, float, float]:
    """The mean scores of the random, the rule and the blind player."""
    with tempfile.TemporaryDirectory() as folder:
        random = mean_score(game, "random", episodes)
        rule = mean_score(game, "rule", episodes, Path(folder))
        return random, rule, mean_score(game, f"blind:{folder}", episodes)


if __name__ == "__main__":
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    title = f"Mean score over {count} seeds"
    table = Table("setting", "random", "rule", "blind", title=title, title_justify="left")
    for name in sys.argv[2:] or sp.GAMES:
        table.add_row(name, *(f"{score:,.2f}" for score in mean_scores(name, count)))
    Console().print(table)
