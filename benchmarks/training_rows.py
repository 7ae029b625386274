"""How many training rows an episode becomes, against `slack`.

`python benchmarks/training_rows.py [TRIALS]` prints a table. Why it matters:

Trainers that take an agent's turns as they were (verifiers and prime-rl, TRL's AsyncGRPO) put all turns into one row as
long as each prompt begins with the one before and its reply; where the window moves, a row begins. The replies are the
same tokens in any case, but each row repeats its prompt. Played by the rule player, counted in budget tokens, from the
records, with the manual pinned: one that is read becomes part of the prompt's beginning, which begins one more row. The
tests of the adapters compare the rows with those of the trainers.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

from rich.console import Console
from rich.table import Table

import smartplay_tools as sp
from smartplay_tools.games.seeds import trial_seed
from smartplay_tools.records import Record

GAMES = {"Hanoi3Disk-v0": 800, "RockPaperScissorBasic-v0": 1500, "MessengerL2-v0": 1000}
"""The games, and the cap on their prompts."""

SLACKS = (0.0, 0.25, 0.5, 0.75)


class Rows(NamedTuple):
    """What an episode, or several on average, are as training rows."""

    turns: float
    rows: float
    tokens: float
    """Of all rows: what a training step computes."""
    trained: float
    """Of the replies: what a training step learns from."""


def rows_of(episode: Record) -> Rows:
    """Return an episode as rows: a row begins where a prompt does not begin with the last one and its reply."""
    lengths: list[int] = []
    previous = None
    for sent in episode.prompts:
        messages, usage = sent.prompt.messages, episode.usage[sent.turn]
        length = usage["prompt"] + usage["reply"]
        if previous is not None and messages[: len(previous)] == previous:
            lengths[-1] = length
        else:
            lengths.append(length)
        previous = [*messages, episode.replies[sent.turn]]
    trained = sum(episode.usage[sent.turn]["reply"] for sent in episode.prompts)
    return Rows(len(episode.prompts), len(lengths), sum(lengths), trained)


def measure(game: str, budget: sp.Budget, trials: int, folder: Path) -> Rows:
    """Return the means over some episodes."""
    per_episode = []
    for trial in range(trials):
        record = folder / f"{len(list(folder.iterdir()))}.jsonl"
        with sp.Episode(
            game, seed=trial_seed(0, game, trial), budget=budget, manual="pinned", transcript=record
        ) as episode:
            sp.play(episode, sp.get_player("rule"))
        per_episode.append(rows_of(Record.read(record)))
    return Rows(*(sum(column) / trials for column in zip(*per_episode, strict=True)))


def main() -> None:
    """Measure all games and print a table."""
    trials = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    table = Table(title=f"Training rows per episode: rule player, {trials} episodes each")
    for column in ("game", "prompt_tokens", "slack", "turns", "rows", "tokens in rows", "of them trained"):
        table.add_column(column, justify="left" if column == "game" else "right")
    with tempfile.TemporaryDirectory() as folder:
        for game, cap in GAMES.items():
            budgets = [sp.Budget(history=None)]
            budgets += [sp.Budget(history=None, prompt_tokens=cap, slack=slack) for slack in SLACKS]
            for budget in budgets:
                means = measure(game, budget, trials, Path(folder))
                limit = ("none", "") if budget.prompt_tokens is None else (str(cap), f"{budget.slack:g}")
                table.add_row(
                    game, *limit, *(f"{value:,.1f}" for value in means[:2]), *(f"{v:,.0f}" for v in means[2:])
                )
    Console(width=110).print(table)


if __name__ == "__main__":
    main()
