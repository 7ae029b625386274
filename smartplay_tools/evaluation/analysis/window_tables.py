"""A sweep as tables: every window beside the reference of its family, and points where they are not scores."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from operator import itemgetter

from smartplay_tools.evaluation.analysis.beside import EARLY, WAY, column_notes, early_notes, shows_points, shows_steps
from smartplay_tools.evaluation.analysis.formats import ShownColumn, TextTable, figures_table
from smartplay_tools.evaluation.analysis.headline import CUT, MANY_CUTS, is_much_cut
from smartplay_tools.evaluation.analysis.names import family_titles, window_names
from smartplay_tools.evaluation.analysis.numbers import (
    IDENTICAL,
    NOTHING,
    count,
    decimals_of,
    dollars,
    interval_notes,
    percent,
    with_interval,
)
from smartplay_tools.evaluation.analysis.pairs import is_control
from smartplay_tools.evaluation.analysis.windows import WindowComparison
from smartplay_tools.types.groups import grouped
from smartplay_tools.types.quantities import short

NOTES = (
    "+-: to the reference, paired by seed; [ ]: 95 % interval",
    "tokens: prompts and replies of an episode; stable: of its prompts, in a prefix that did not change",
    "*: on the game's Pareto front of score against tokens",
)
FULL_NOTE = "full context: nothing left the window in any episode, as far as it was played"
TOGETHER = "the intervals of the {compared} differences hold together in 95 of 100 sweeps (max-T)"
CONTROLS = "controls, which do not read their prompts, are not among the differences that hold together"
COST_NOTE = "$: on the front of score against cost; USD: of an episode"
CUT_NOTE = (
    f"{CUT}: at least {MANY_CUTS:.0%} of the tool results were cut, so the difference is not one of memory alone; "
    "docs/experiments.md lists the caps from which on nothing is cut"
)

STEPS: ShownColumn[WindowComparison] = ("steps", lambda c: f"{c.means['steps'].mean:,.1f}")


def windows_table(comparisons: Sequence[WindowComparison]) -> TextTable:
    """Return the table of a sweep, with a heading for each family of cells; its intervals hold together."""
    controls = [is_control(c.cell.player) for c in comparisons if c.together]
    priced = any("cost" in c.means and c.means["cost"].mean for c in comparisons)
    has_best = any("way_to_best" in c.means for c in comparisons)
    beside = [c.beside for c in comparisons]
    has_steps = shows_steps(beside)

    def figures(members: Sequence[WindowComparison]) -> Sequence[ShownColumn[WindowComparison]]:
        decimals = decimals_of(c.means["score"] for c in members)
        return (
            ("n", lambda c: count(c.episodes, c.means["score"])),
            *([STEPS] if has_steps else []),
            ("score", lambda c: with_interval(c.means["score"], decimals)),
            ("+-", lambda c: _difference(c, decimals)),
            ("tokens", lambda c: short(c.means["tokens"].mean)),
            ("stable", lambda c: percent(c.means["prefix_share"].mean) if "prefix_share" in c.means else NOTHING),
            *([("to best", lambda c: with_interval(c.means.get("way_to_best"), 2))] if has_best else []),
            *([("USD", lambda c: dollars(c.means["cost"].mean) if "cost" in c.means else NOTHING)] if priced else []),
            ("", lambda c: _marks(c, priced=priced)),
        )

    notes = [
        *([TOGETHER.format(compared=controls.count(False))] if controls.count(False) > 1 else []),
        *([CONTROLS] if any(controls) else []),
        *NOTES,
        *([FULL_NOTE] if any(c.is_reference and c.is_whole for c in comparisons) else []),
        *interval_notes([*(c.means["score"] for c in comparisons), *(c.together for c in comparisons)]),
        *([IDENTICAL] if any(c.is_identical for c in comparisons) else []),
        *([COST_NOTE] if priced else []),
        *([WAY] if has_best else []),
        *([CUT_NOTE] if any(map(is_cut, comparisons)) else []),
        *column_notes(beside, points=False),
        *early_notes(beside),
    ]
    return cells_table("windows", comparisons, figures, notes)


def cells_table(
    title: str,
    comparisons: Sequence[WindowComparison],
    figures: Callable[[Sequence[WindowComparison]], Sequence[ShownColumn[WindowComparison]]],
    notes: Sequence[str],
) -> TextTable:
    """Return a table with a section for each family and a line for each cell; `figures` has a family's columns."""
    titled = zip(family_titles([c.cell for c in comparisons]), comparisons, strict=True)
    families = {heading: [c for _, c in pairs] for heading, pairs in grouped(titled, itemgetter(0)).items()}
    return figures_table(title, "window", {name: _named(own) for name, own in families.items()}, figures, notes)


def _named(family: Sequence[WindowComparison]) -> list[tuple[str, WindowComparison]]:
    names = window_names([c.cell for c in family])
    return [(name + EARLY * bool(each.ends), each) for name, each in zip(names, family, strict=True)]


POINTS_NOTE = "of an episode, with 95 % intervals; +-: to the reference, paired by seed, each interval by itself"


def points_tables(comparisons: Sequence[WindowComparison]) -> list[TextTable]:
    """Return the points of every cell and their differences, where points are not what scores count."""
    beside = [c.beside for c in comparisons]
    if not shows_points(beside):
        return []

    def figures(_: Sequence[WindowComparison]) -> Sequence[ShownColumn[WindowComparison]]:
        return (
            *([STEPS] if shows_steps(beside) else []),
            ("points", lambda c: with_interval(c.means["reward"], 2, sign="-")),
            ("+-", lambda c: with_interval(c.differences.get("reward"), 2, sign="+")),
        )

    return [cells_table("points", comparisons, figures, [POINTS_NOTE, *column_notes(beside), *early_notes(beside)])]


def is_cut(comparison: WindowComparison) -> bool:
    """Whether too many results of a cell were cut for its score to measure its window alone."""
    return is_much_cut(comparison.cut_share)


def marks_of(comparison: WindowComparison) -> str:
    """Return the marks of a cell in figures: of cut results, and of episodes that ended before their game did."""
    return CUT * is_cut(comparison) + EARLY * bool(comparison.ends)


def _difference(comparison: WindowComparison, decimals: int) -> str:
    if comparison.is_reference:
        return "full context" if comparison.is_whole else "reference"
    if comparison.is_identical:
        return "identical"
    return with_interval(comparison.together, decimals, sign="+") if comparison.together else "no pairs"


def _marks(comparison: WindowComparison, *, priced: bool) -> str:
    fronts = ("*" if comparison.on_token_front else "") + ("$" if priced and comparison.on_cost_front else "")
    return fronts + CUT * is_cut(comparison)
