"""The headline of a run: one short table, shown first, with the scores, tokens and cost of every player.

It fits 80 columns. `TERMS` explains its columns, and `details` has all other tables.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping, Sequence
from importlib import resources

from smartplay_tools.evaluation.analysis.beside import EARLY, column_notes, early_notes, shows_points, shows_steps
from smartplay_tools.evaluation.analysis.formats import ShownColumn, TextTable, figures_table
from smartplay_tools.evaluation.analysis.names import apart
from smartplay_tools.evaluation.analysis.numbers import (
    NOTHING,
    count,
    decimals_of,
    dollars,
    fixed,
    interval_notes,
    percent,
    with_interval,
)
from smartplay_tools.evaluation.analysis.summary import CellSummary, RunSummary
from smartplay_tools.types.quantities import short

CUT = "\N{DAGGER}"
"""The mark of cells in which tool results were cut to fit."""

UNPLAYED = "!"
"""The mark of cells with episodes in which no action was ever played."""

MANAGED = "~"
"""The mark of cells with episodes whose context a provider managed."""

INTERVALS = "[ ]: 95 % interval of the mean"
OF_AN_EPISODE = "tokens, USD: of an episode, mean"
PRIVILEGED = "*: privileged, it knows the game's state and not only its messages"

MANY_CUTS = 0.01
"""The share of cut results at which a table begins to warn."""

TERMS: Mapping[str, str] = tomllib.loads(resources.files(__package__).joinpath("terms.toml").read_text("utf-8"))
"""The meaning of the terms in the tables."""


Named = tuple[str, CellSummary]
"""A cell and its name in a table."""


def headline(summary: RunSummary) -> TextTable:
    """Return the short table of a run: score, share of the human's, tokens and cost for every game and player."""
    beside = [cell.beside for cell in summary.cells]
    has_steps, has_points = shows_steps(beside), shows_points(beside)

    def figures(cells: Sequence[CellSummary]) -> Sequence[ShownColumn[CellSummary]]:
        decimals = decimals_of(cell.score for cell in cells)
        return (
            ("n", lambda c: count(c.episodes, c.score)),
            *([("steps", lambda c: f"{c.beside.steps:,.1f}")] if has_steps else []),
            ("score", lambda c: with_interval(c.score, decimals)),
            *([("points", lambda c: fixed(c.reward.mean, 2, "+"))] if has_points else []),
            ("% human", lambda c: f"{100 * c.normalized_score.mean:.0f}" if c.normalized_score else NOTHING),
            ("tokens", lambda c: short(c.episode_tokens.mean)),
            ("USD", lambda c: dollars(c.episode_cost and c.episode_cost.mean)),
        )

    notes = [INTERVALS, *column_notes(beside), OF_AN_EPISODE, *interval_notes(cell.score for cell in summary.cells)]
    notes += warnings(summary.cells)
    return figures_table(shared(summary), "game and player", by_game(summary), figures, notes)


def by_game(summary: RunSummary) -> dict[str, list[Named]]:
    """Return the cells of each game with their names: the player, and what not all cells of the table were given."""
    games: dict[str, list[Named]] = {}
    given, _ = apart([summary.label_of(cell) for cell in summary.cells])
    for cell, label in zip(summary.cells, given, strict=True):
        name = ", ".join(filter(None, [player_name(cell), label]))
        games.setdefault(game_name(cell), []).append((name, cell))
    return games


def shared(summary: RunSummary) -> str:
    """Return a short description of what all cells of the run were given; empty for the default."""
    return apart([summary.label_of(cell) for cell in summary.cells])[1]


def warnings(cells: Iterable[CellSummary]) -> list[str]:
    """Return the warnings to read before comparing these cells."""
    cells = list(cells)
    notes = [PRIVILEGED] if any(cell.privileged for cell in cells) else []
    if unplayed := sum(cell.unplayed for cell in cells):
        notes.append(
            f"{UNPLAYED}: {unplayed} without any action, whose scores say nothing of how well the player plays"
        )
    if managed := sum(cell.managed for cell in cells):
        notes.append(
            f"{MANAGED}: {managed} with prompts that the provider edited or compacted itself, so that what the model "
            "saw is not on record, and no count is exact"
        )
    notes += early_notes(cell.beside for cell in cells)
    worst = max((cell.cut_share or 0.0 for cell in cells), default=0.0)
    if is_much_cut(worst):
        notes.append(
            f"{CUT}: tool results were cut to fit (up to {percent(worst)} of them), so a low score is not that "
            "of less memory alone; raise --prompt-tokens or --result-tokens"
        )
    return notes


def is_much_cut(share: float | None) -> bool:
    """Whether so large a share of tool results was cut that a score does not measure its window alone."""
    return (share or 0.0) >= MANY_CUTS


def player_name(cell: CellSummary) -> str:
    """Return the player's name with its marks."""
    marks = {"*": cell.privileged, UNPLAYED: cell.unplayed > 0, MANAGED: cell.managed > 0, EARLY: cell.early > 0}
    marks |= {CUT: is_much_cut(cell.cut_share)}
    return cell.cell.player + "".join(mark for mark, holds in marks.items() if holds)


def game_name(cell: CellSummary) -> str:
    """Return the game, with engine and options if it has them."""
    made = [cell.cell.engine] if cell.cell.engine else []
    made += [f"{name}={value}" for name, value in cell.cell.options.items()]
    return f"{cell.cell.game} ({', '.join(made)})" if made else cell.cell.game
