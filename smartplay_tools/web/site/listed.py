"""An episode in the list of a run: an array of plain values, since ten thousand are then about a megabyte of JSON."""

from __future__ import annotations

from typing import Any

from smartplay_tools.evaluation.run_folder.follower import Result

COLUMNS = (
    *("record", "status", "game", "player", "budget", "trial", "seed", "score", "normalized", "steps"),
    *("tokens", "cost", "mistakes", "cut", "counted", "end", "time", "date"),
)
"""The values of an episode in the list; its date is when its record was written last, in seconds since the epoch, and
`counted` its score as means count it."""


def listed(**values: Any) -> list[Any]:
    """Return an episode as an array, in the order of `COLUMNS`; what is not given is None."""
    return [values.get(name) for name in COLUMNS]


def figures(result: Result) -> dict[str, Any]:
    """Return what the list says of a result."""
    return {
        "score": result.score,
        "normalized": result.normalized_score,
        "steps": result.steps,
        "tokens": result.spent.tokens,
        "cost": result.spent.cost,
        "mistakes": result.mistakes,
        "cut": result.cut_results,
        "counted": result.mean_score,
        "end": result.end_reason,
    }
