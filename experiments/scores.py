"""How the included players score at every setting, and what that makes visible in as many trials as the paper has.

    python experiments/scores.py             # plays them; continues where it stopped
    python experiments/scores.py --publish   # the same, and puts rows, tables and figure into the checkout

Budgets are the settings' own.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from page_tables import Experiment, arguments, complete, markdown_table, mean_of, mean_score, score_of

import smartplay_tools as sp
from smartplay_tools.evaluation.analysis.decisions import POWERS, mde
from smartplay_tools.evaluation.analysis.figures.run import run_figures
from smartplay_tools.evaluation.analysis.grouping import by_cell
from smartplay_tools.evaluation.analysis.pairs import reward, score, steps
from smartplay_tools.games.paper_tables import CAPABILITIES, PAPER_RESULTS, PAPER_SETTINGS
from smartplay_tools.records.rows import Row
from smartplay_tools.types.groups import grouped

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TRIALS = {
    "bandit": 100, "rock_paper_scissors": 50, "hanoi": 20, "messenger": 20, "crafter": 10, "minecraft": 5,
}  # fmt: skip
"""Worlds of each setting, by the family of games."""
PLAYERS = ("random", "rule")
LINES = {
    "bandit": ("win-stay", "leave-after-two"),
    "rock_paper_scissors": ("win-stay", "leave-after-two", "last-hand", "count-last-5"),
}
"""The baselines of one line that can play a game, besides each of its actions again and again."""


def play(out: Path, families: Sequence[str] | None) -> Iterator[Row]:
    """Play every setting with every player and every baseline, and yield the rows."""
    settings = [game for game in sp.GAMES if game in sp.GAMES.benchmark]
    for family, games in grouped(settings, lambda game: sp.GAMES[game].family).items():
        if not families or family in families:
            actions = range(1, sp.GAMES[games[0]].count_actions() + 1)
            players = (*PLAYERS, *LINES.get(family, ()), *(f"always:{number}" for number in actions))
            yield from complete(games, players, trials=TRIALS[family], out=out / family, executor="inline").rows


def scores(rows: Sequence[Row]) -> str:
    """The mean score of every player at every setting, beside those of the paper's best model and of people."""
    people, *models = PAPER_RESULTS
    lines = []
    for game, cells in grouped(by_cell(rows), lambda group: group[0].game).items():
        played = {cell.player: own for cell, own in cells}
        means = {player: score_of(played[player]) for player in PLAYERS}
        name, line = best_line(played)
        means["one line"] = f"{score_of(line)}, `{name}`"
        best = f"{max(model.raw[game] for model in models):,g}" if game in people.raw else ""
        human = f"{people.raw[game]:,g}" if game in people.raw else ""
        lines.append((f"`{game}`", str(len(cells[0][1])), *(means[player] for player in SHOWN), best, human))
    return markdown_table(("setting", "worlds", *HEADINGS, "best model of the paper", "human"), lines)


SHOWN = ("random", "one line", "rule")
HEADINGS = ("random", "best of one line", "rule")


def best_line(played: Mapping[str, Sequence[Row]]) -> tuple[str, Sequence[Row]]:
    """Return the baseline of one line with the best mean score among the players of a setting."""
    lines = {player: rows for player, rows in played.items() if player not in PLAYERS}
    return max(lines.items(), key=lambda pair: mean_score(pair[1]).mean)


def points(rows: Sequence[Row]) -> str:
    """The points of the settings that pay others than their score counts, with the mean number of steps."""
    lines = []
    for game, cells in grouped(by_cell(rows), lambda group: group[0].game).items():
        played = {cell.player: own for cell, own in cells}
        shown = [played["random"], best_line(played)[1], played["rule"]]
        played_rows = [row for own in shown for row in own]
        if any(map(reward, played_rows)) and any(reward(row) != score(row) for row in played_rows):
            told = [f"{mean_of(own, reward):+.2f} ({mean_of(own, steps):,.0f})" for own in shown]
            lines.append((f"`{game}`", *told))
    return markdown_table(("setting", *HEADINGS), lines)


def visible(rows: Sequence[Row]) -> str:
    """The differences that the paper's trials show at its settings, from the spread of these scores."""
    spread = {(cell.game, cell.player): mean_score(own).sd for cell, own in by_cell(rows)}
    lines = []
    for game in (game for game in PAPER_SETTINGS if (game, "rule") in spread):
        trials, random, rule = sp.GAMES[game].trials, spread[game, "random"], spread[game, "rule"]
        unlike, alike = math.hypot(random, rule), math.hypot(random, random)
        least, surely = (_three(mde(unlike, trials, power)) for power in POWERS)
        shown = _three(random), _three(rule), f"{least} ({surely})", _three(mde(alike, trials))
        lines.append((f"`{game}`", str(trials), *shown))
    headings = ("setting", "trials", "sd of `random`", "sd of `rule`")
    return markdown_table((*headings, "MDE, `rule` against `random`", "MDE, two as variable as `random`"), lines)


def degrees() -> str:
    """How much each setting asks for each capability; the settings of a family that agree share a column."""
    columns: dict[tuple[str, tuple[int, ...]], list[str]] = {}
    for spec in (sp.GAMES[game] for game in sp.GAMES if game in sp.GAMES.benchmark):
        columns.setdefault((spec.family, tuple(spec.challenges.values())), []).append(spec.id)
    headings = [ids[0] if len(ids) == 1 else f"{ids[0]} and {len(ids) - 1} more" for ids in columns.values()]
    lines = [(name, *(str(own[at]) for _, own in columns)) for at, name in enumerate(CAPABILITIES)]
    return markdown_table(("capability", *headings), lines)


def _three(value: float) -> str:
    return f"{value:,.0f}" if value >= 100 else f"{value:.3g}"


def capabilities(rows: Sequence[Row]) -> dict[str, Figure]:
    """The figure of capabilities of `rule` and `random`, at the settings that have normalised scores."""
    players = [row for row in rows if row["game"] in PAPER_SETTINGS and row["player"] in PLAYERS]
    return {"capabilities-capabilities": run_figures(players)["capabilities"]}


def tables(rows: Sequence[Row]) -> dict[str, str]:
    """Return the tables of pages by their names."""
    return {"scores": scores(rows), "points": points(rows), "visible": visible(rows)}


DEGREES = Experiment("degrees", lambda _: {"degrees": degrees()}, read=lambda: None)
EXPERIMENT = Experiment("scores", tables, capabilities)


def main() -> None:
    """Play, and print or publish the tables."""
    parser = arguments(__doc__, "runs/scores")
    parser.add_argument("--family", action="append", help="play the settings of this game alone; repeatable")
    asked = parser.parse_args()
    EXPERIMENT.conclude(play(asked.out, asked.family), publishes=asked.publish)


if __name__ == "__main__":
    main()
