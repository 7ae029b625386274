"""Results of a submission: the mean of every game under every budget, from rows."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable

from smartplay_tools.evaluation.board.submissions.metadata import CellResult
from smartplay_tools.records.rows import Row

DIGITS = 6


def cell_results(rows: Iterable[Row]) -> list[CellResult]:
    """Return a result for every game and budget that was asked for, in the order of the rows."""
    groups: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        groups.setdefault((row["game"], json.dumps(row["asked"], sort_keys=True)), []).append(row)
    return [_result(game, members) for (game, _), members in groups.items()]


def _result(game: str, rows: list[Row]) -> CellResult:
    normalized = [row["normalized_score"] for row in rows]
    costs = [row["cost"] for row in rows]
    return CellResult(
        game=game,
        budget=rows[0]["asked"],
        episodes=len(rows),
        score=_mean([row["score"] for row in rows]),
        normalized_score=None if None in normalized else _mean(normalized),
        cost=None if None in costs else round(math.fsum(costs), DIGITS),
    )


def _mean(values: list[float]) -> float:
    return round(math.fsum(values) / len(values), DIGITS)
