"""The trials that comparisons take: a plan for each pairing of a comparison, and its table."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from smartplay_tools.evaluation.analysis.comparison import Comparison, Pairing, Side
from smartplay_tools.evaluation.analysis.comparison_tables import side_names
from smartplay_tools.evaluation.analysis.decisions import POWERS, Margin, Needed, plan_pairs
from smartplay_tools.evaluation.analysis.formats import TextTable, columns, sections
from smartplay_tools.records.rows import grouped

NOTES = (
    "a | b: to see a difference in 8 or in 9 of 10 such comparisons (two-sided, 5 %)",
    "trials: of each side in all, and how many more; at most: if sd is small by chance (its upper 80 % limit)",
    "MDE: the smallest difference that the pairs there are show as often",
)


@dataclass(frozen=True)
class Planned:
    """The trials that a pairing needs, or why they are not known."""

    game: str
    name: str
    side: Side
    reference: Side
    pairs: int
    needed: Needed | None
    reason: str | None


def plan_comparisons(comparison: Comparison, difference: Margin) -> list[Planned]:
    """Plan every pairing of a comparison, so that it shows a difference."""
    names = side_names(comparison)
    planned = []
    for each in comparison.pairings:
        plan = _plan(each, difference.points(each.game)) if each.pairs else "no pairs"
        needed, reason = (None, plan) if isinstance(plan, str) else (plan, None)
        name = f"{names[each.side]} against {names[each.reference]}"
        planned.append(Planned(each.game, name, each.side, each.reference, each.pairs, needed, reason))
    return planned


def _plan(each: Pairing, points: float) -> Needed | str:
    """The trials of a pairing: where trials carry something over, those of the chains that it takes."""
    estimate, carrying = each.differences["score"], [s for s in (each.side, each.reference) if s.facts.get("carry")]
    if not carrying:
        return plan_pairs(estimate, points, "pairs" if estimate.episodes == each.pairs else "worlds")
    plan = plan_pairs(estimate, points, "chains")
    if isinstance(plan, str):
        return plan
    # Several chains are of limited lengths: without a limit, all trials are one chain.
    length = math.lcm(*(side.facts["chain"] for side in carrying))
    needed, at_most = ([length * chains for chains in counts] for counts in (plan.needed, plan.at_most))
    return replace(plan, pairs=length * plan.pairs, needed=tuple(needed), at_most=tuple(at_most))


def planning_table(planned: Sequence[Planned]) -> TextTable:
    """Return the table of trials, with a section for each game."""
    rows = sections((game, map(_row, own)) for game, own in grouped(planned, lambda each: each.game).items())
    headings = columns("", "pairs", "sd", "D", "MDE", "trials", "more", "at most")
    reasons = dict.fromkeys(f"-: {each.reason}" for each in planned if each.reason)
    return TextTable("trials to see a difference of D", headings, rows, (*NOTES, *reasons))


def _row(each: Planned) -> tuple[str, ...]:
    if each.needed is None:
        return (f"  {each.name}", f"{each.pairs}", *["-"] * 6)
    needed = each.needed
    mdes = " | ".join(f"{value:.3g}" for value in needed.mde)
    more = [max(0, trials - needed.pairs) for trials in needed.needed]
    counts = (" | ".join(f"{value:,}" for value in values) for values in (needed.needed, more, needed.at_most))
    return f"  {each.name}", f"{each.pairs}", f"{needed.sd:.3g}", f"{needed.difference:g}", mdes, *counts


def as_rows(planned: Sequence[Planned]) -> list[dict[str, Any]]:
    """Return a flat row for every pairing."""
    rows = []
    for each in planned:
        row: dict[str, Any] = {"game": each.game, "comparison": each.name, "pairs": each.pairs, "reason": each.reason}
        needed = each.needed
        row |= {"difference": needed and needed.difference, "sd": needed and needed.sd}
        for at, power in enumerate(POWERS):
            row |= {
                f"{name}_{power:.0%}": needed and getattr(needed, name)[at] for name in ("mde", "needed", "at_most")
            }
        rows.append(row)
    return rows
