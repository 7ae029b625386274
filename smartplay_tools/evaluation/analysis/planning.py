"""The trials that a table of comparisons takes: a plan for each of its lines, one for all together, and their prices.

A plan is of the table that will be printed: of a sweep's, with the reference of each family and intervals that hold
together, or of a comparison's, with intervals that hold each by itself. Controls have no line (`pairs.is_control`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.analysis.comparison import Comparison
from smartplay_tools.evaluation.analysis.comparison_tables import side_names
from smartplay_tools.evaluation.analysis.decisions import POWERS, Margin, Needed, pairs_needed, plan_pairs
from smartplay_tools.evaluation.analysis.formats import TextTable, columns, sections
from smartplay_tools.evaluation.analysis.names import family_titles, window_names
from smartplay_tools.evaluation.analysis.numbers import NOTHING, dollars
from smartplay_tools.evaluation.analysis.pairs import is_control
from smartplay_tools.evaluation.analysis.windows import WindowComparison
from smartplay_tools.statistics.intervals import CONFIDENCE, MeanEstimate
from smartplay_tools.types.groups import grouped
from smartplay_tools.types.quantities import short

ALL = "all together"
NOTES = (
    "a | b: what shows a difference of D in 8 or in 9 of 10 such tables (two-sided, {level:.2g} %)",
    "trials: of each cell in all; at most: if sd is small by chance (its upper 80 % limit)",
    "MDE: the smallest difference that the pairs there are show as often",
    f"tokens, USD: of these trials, of the cell and its reference; {ALL}: every line shows its difference, every cell",
)

Means = tuple[float, float | None]
"""The tokens of an episode, and its US dollars if prices are known."""


@dataclass(frozen=True)
class Contrast:
    """A line of a table of comparisons, of which the trials are planned."""

    title: str
    """The game, or what the lines of a family have in common."""
    game: str
    name: str
    difference: MeanEstimate | None
    """Of scores, over the independent units; None without pairs."""
    pairs: int
    is_carrying: bool
    """Whether trials carry something over."""
    costs: tuple[tuple[Any, Means], tuple[Any, Means]]
    """The cell and its reference, each with what an episode takes."""

    @property
    def length(self) -> int:
        """The trials of an independent unit: the repeats of a world, or the trials of a chain."""
        return 1 if self.difference is None else math.ceil(self.pairs / self.difference.episodes)

    @property
    def unit(self) -> str:
        """What the values of the difference are of."""
        return "chains" if self.is_carrying else "worlds" if self.length > 1 else "pairs"


@dataclass(frozen=True)
class Planned:
    """The trials of a line, or why they are not known; each tuple has a figure for each of `POWERS`."""

    contrast: Contrast | None
    """None for the line of all together."""
    needed: Needed | None
    reason: str | None
    trials: tuple[int, ...] = ()
    tokens: tuple[float, ...] = ()
    """Of all trials of the cell and its reference or, for all together, of all cells."""
    cost: tuple[float, ...] | None = None


def of_comparison(comparison: Comparison) -> list[Contrast]:
    """Return the lines of the table of a comparison; those of controls only if it has no others."""
    names, contrasts = side_names(comparison), []
    references = {(game, side): _means(means) for game, side, means in comparison.references}
    lines = [each for each in comparison.pairings if not is_control(each.side.player)]
    for each in lines or comparison.pairings:
        carries = any(side.facts.get("carry") for side in (each.side, each.reference))
        own, other = (each.game, each.side), (each.game, each.reference)
        costs = (own, _means(each.means)), (other, references[other])
        name = f"{names[each.side]} against {names[each.reference]}"
        difference = each.differences.get("score")
        contrasts.append(Contrast(each.game, each.game, name, difference, each.pairs, carries, costs))
    return contrasts


def of_windows(comparisons: Sequence[WindowComparison]) -> list[Contrast]:
    """Return the lines of the table of a sweep."""
    cells, contrasts = [each.cell for each in comparisons], []
    means = {each.cell.key(): _means(each.means) for each in comparisons}
    for each, title, name in zip(comparisons, family_titles(cells), window_names(cells), strict=True):
        if each.together is not None and not is_control(each.cell.player):
            keys = each.cell.key(), each.reference.key()
            costs = ((keys[0], means[keys[0]]), (keys[1], means[keys[1]]))
            carries = each.cell.rules["carry"] is not None
            contrasts.append(Contrast(title, each.cell.game, name, each.together, each.pairs, carries, costs))
    return contrasts


def _means(estimates: Any) -> Means:
    cost = estimates.get("cost")
    return estimates["tokens"].mean, None if cost is None else cost.mean


def plan(contrasts: Sequence[Contrast], difference: Margin, confidence: float = CONFIDENCE) -> list[Planned]:
    """Plan every line, so that its interval at this level excludes 0; with several lines, a last one is for all."""
    if not contrasts:
        raise InvalidArgumentError("There is nothing to plan: no two cells are compared, controls aside.")
    planned = [_plan(each, difference.points(each.game), confidence) for each in contrasts]
    if len(planned) > 1:
        planned.append(_all_together(planned, confidence))
    return planned


def _plan(each: Contrast, points: float, confidence: float) -> Planned:
    needed = "no pairs" if each.difference is None else plan_pairs(each.difference, points, each.unit, confidence)
    if isinstance(needed, str):
        return Planned(each, None, needed)
    trials = tuple(each.length * count for count in needed.needed)
    tokens, cost = _price(dict(each.costs), trials)
    return Planned(each, needed, None, trials, tokens=tokens, cost=cost)


def _all_together(planned: Sequence[Planned], confidence: float) -> Planned:
    """The trials with which all lines show their difference at once, at least as often as each power says."""
    known = [(each.contrast, each.needed) for each in planned if each.contrast is not None and each.needed is not None]
    if len(known) < len(planned):
        return Planned(None, None, "the trials of a line are not known")
    chances = [1 - (1 - power) / len(known) for power in POWERS]
    trials = tuple(
        max(line.length * pairs_needed(own.difference, own.sd, chance, confidence) for line, own in known)
        for chance in chances
    )
    tokens, cost = _price({key: means for line, _ in known for key, means in line.costs}, trials)
    return Planned(None, None, None, trials, tokens=tokens, cost=cost)


def _price(costs: dict[Any, Means], trials: Sequence[int]) -> tuple[tuple[float, ...], tuple[float, ...] | None]:
    """The tokens and US dollars of so many trials of each cell."""
    tokens = sum(own for own, _ in costs.values())
    prices = [cost for _, cost in costs.values() if cost is not None]
    price = tuple(count * sum(prices) for count in trials) if len(prices) == len(costs) else None
    return tuple(count * tokens for count in trials), price


def planning_table(planned: Sequence[Planned], confidence: float = CONFIDENCE) -> TextTable:
    """Return the table of trials, with a section for each game, or for each family of a sweep."""
    priced = any(each.cost and any(each.cost) for each in planned)
    by_title = grouped(planned, lambda each: "all" if each.contrast is None else each.contrast.title)
    rows = sections((title, [_row(each, priced) for each in own]) for title, own in by_title.items())
    headings = columns("", "pairs", "sd", "D", "MDE", "trials", "at most", "tokens", *(["USD"] if priced else []))
    reasons = dict.fromkeys(f"{NOTHING}: {each.reason}" for each in planned if each.reason)
    notes = [note.format(level=100 * (1 - confidence)) for note in NOTES]
    return TextTable("trials to see a difference of D", headings, rows, (*notes, *reasons))


def _row(each: Planned, priced: bool) -> tuple[str, ...]:
    needed, length = each.needed, 1 if each.contrast is None else each.contrast.length
    figures = [NOTHING] * 3 + [_both(each.trials, "{:,}".format), NOTHING]
    if needed is not None:
        at_most = [length * count for count in needed.at_most]
        figures = [f"{needed.sd:.3g}", f"{needed.difference:g}", _both(needed.mde, "{:.3g}".format)]
        figures += [_both(each.trials, "{:,}".format), _both(at_most, "{:,}".format)]
    figures += [_both(each.tokens, short), *([_both(each.cost or (), dollars)] if priced else [])]
    name, pairs = (ALL, "") if each.contrast is None else (each.contrast.name, f"{each.contrast.pairs}")
    return (f"  {name}", pairs, *figures)


def _both(values: Sequence[Any], show: Any) -> str:
    return " | ".join(map(show, values)) or NOTHING


def as_rows(planned: Sequence[Planned]) -> list[dict[str, Any]]:
    """Return a flat row for every line."""
    rows = []
    for each in planned:
        line, needed = each.contrast, each.needed
        row: dict[str, Any] = {"game": line and line.game, "comparison": ALL if line is None else line.name}
        row |= {"pairs": line and line.pairs, "reason": each.reason}
        row |= {"difference": needed and needed.difference, "sd": needed and needed.sd}
        for at, power in enumerate(POWERS):
            row |= {f"{name}_{power:.0%}": needed and getattr(needed, name)[at] for name in ("mde", "at_most")}
            figures = {"needed": each.trials, "tokens": each.tokens, "cost": each.cost}
            row |= {f"{name}_{power:.0%}": own[at] if own else None for name, own in figures.items()}
        rows.append(row)
    return rows
