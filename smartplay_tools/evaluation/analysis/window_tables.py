"""A sweep as a table: every window, compared with the full context of its family."""

from __future__ import annotations

from collections.abc import Sequence
from operator import itemgetter

from smartplay_tools.evaluation.analysis.formats import (
    NOTHING,
    TextTable,
    columns,
    decimals_of,
    dollars,
    interval_notes,
    percent,
    with_interval,
)
from smartplay_tools.evaluation.analysis.headline import CUT, EARLY, MANY_CUTS, TERMS, is_much_cut
from smartplay_tools.evaluation.analysis.names import family_titles, window_names
from smartplay_tools.evaluation.analysis.windows import WindowComparison
from smartplay_tools.evaluation.quantities import short
from smartplay_tools.records.rows import grouped

NOTES = (
    "+-: to full context, paired by seed; [ ]: 95 % interval",
    "tokens: prompts and replies of an episode; stable: of its prompts, in a prefix that did not change",
    "*: on the game's Pareto front of score against tokens",
)
TOGETHER = "the intervals of the {compared} differences hold together in 95 of 100 sweeps (Bonferroni)"
SINGLE = "the intervals of the {compared} differences hold each by itself: of twenty, one is expected to miss"
COST_NOTE = "$: on the front of score against cost; USD: of an episode"
CUT_NOTE = (
    f"{CUT}: at least {MANY_CUTS:.0%} of the tool results were cut, so the difference is not one of memory alone; "
    "docs/experiments.md lists the caps from which on nothing is cut"
)


def windows_table(comparisons: Sequence[WindowComparison], *, single: bool = False) -> TextTable:
    """Return the table of a sweep, with a heading for each family of cells.

    The intervals of differences hold together, or with `single` each by itself.
    """
    differences = [c.differences.get("score") if single else c.together for c in comparisons]
    compared = sum(difference is not None for difference in differences)
    priced = any("cost" in c.means and c.means["cost"].mean for c in comparisons)
    rows: list[tuple[str, ...]] = []
    titled = zip(family_titles([c.cell for c in comparisons]), comparisons, strict=True)
    for title, pairs in grouped(titled, itemgetter(0)).items():
        members = [comparison for _, comparison in pairs]
        decimals = decimals_of(c.means["score"] for c in members)
        rows.append((title,))
        for name, comparison in zip(window_names([c.cell for c in members]), members, strict=True):
            rows.append((f"  {name}", *_figures(comparison, decimals, priced=priced, single=single)))
    headings = columns("window", "n", "score", "+-", "tokens", "stable", *(["USD"] if priced else []), "")
    held = (SINGLE if single else TOGETHER).format(compared=compared)
    notes = [
        *([held] if compared > 1 else []),
        *NOTES,
        *interval_notes([*(c.means["score"] for c in comparisons), *differences]),
        *([COST_NOTE] if priced else []),
        *([CUT_NOTE] if any(map(is_cut, comparisons)) else []),
        *([f"{EARLY}: {TERMS[EARLY]}"] if any(c.early for c in comparisons) else []),
    ]
    return TextTable("windows", headings, tuple(rows), tuple(notes))


def is_cut(comparison: WindowComparison) -> bool:
    """Whether too many results of a cell were cut for its score to measure its window alone."""
    return is_much_cut(comparison.cut_share)


def _figures(comparison: WindowComparison, decimals: int, *, priced: bool, single: bool) -> tuple[str, ...]:
    means = comparison.means
    share, cost = means.get("prefix_share"), means.get("cost")
    difference = comparison.differences.get("score") if single else comparison.together
    compared = "no pairs" if difference is None else with_interval(difference, decimals, sign="+")
    marks = ("*" if comparison.on_token_front else "") + ("$" if priced and comparison.on_cost_front else "")
    return (
        f"{comparison.episodes}",
        with_interval(means["score"], decimals),
        "full context" if comparison.is_full else compared,
        short(means["tokens"].mean),
        NOTHING if share is None else percent(share.mean),
        *([NOTHING if cost is None else dollars(cost.mean)] if priced else []),
        marks + CUT * is_cut(comparison) + EARLY * (comparison.early > 0),
    )
