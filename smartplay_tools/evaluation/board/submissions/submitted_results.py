"""Results of a submission: the mean of every game under every budget, from rows."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from statistics import fmean

from smartplay_tools.evaluation.board.submissions.metadata import CellResult
from smartplay_tools.records.groups import grouped
from smartplay_tools.records.rows import Row

DIGITS = 6


def by_cell(rows: Iterable[Row]) -> dict[tuple[str, str], list[Row]]:
    """Return rows by their game and by what was asked for in their budget, as JSON."""
    return grouped(rows, lambda row: (row["game"], json.dumps(row["asked"], sort_keys=True)))


def cell_results(rows: Iterable[Row]) -> list[CellResult]:
    """Return a result for every game and budget that was asked for, in the order of the rows."""
    return [_result(game, members) for (game, _), members in by_cell(rows).items()]


def normalized_scores(rows: Iterable[Row]) -> list[float]:
    """Return the normalised scores of a cell; none if an episode has none."""
    scores = [row["normalized_score"] for row in rows]
    return [] if None in scores else scores


def total_cost(rows: Iterable[Row]) -> float | None:
    """Return the cost of all episodes in US dollars; None where it is not known."""
    costs = [row["cost"] for row in rows]
    return None if None in costs else math.fsum(costs)


def _result(game: str, rows: list[Row]) -> CellResult:
    normalized, cost = normalized_scores(rows), total_cost(rows)
    return CellResult(
        game=game,
        budget=rows[0]["asked"],
        episodes=len(rows),
        score=round(fmean(row["score"] for row in rows), DIGITS),
        normalized_score=round(fmean(normalized), DIGITS) if normalized else None,
        cost=None if cost is None else round(cost, DIGITS),
    )
