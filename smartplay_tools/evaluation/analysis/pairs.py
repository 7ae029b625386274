"""The comparison of two cells by pairs of episodes with the same seed.

The seeds of a run are paired: trial i of a game has the same seed in every cell. The world of a seed (which machine
pays, what the opponent prefers, where the cows are) is therefore the same on both sides of a difference and cancels
out, so that far fewer episodes are needed to show whether a smaller window costs anything.

The interval of a mean difference is computed by `intervals`, with the differences as the sample: pairs are resampled as
a whole, 10,000 times with a fixed seed. An episode whose counterpart is missing (it failed, or was not played yet) is
in no pair.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

from smartplay_tools.evaluation.analysis.intervals import MeanEstimate, mean_estimate
from smartplay_tools.records.rows import Row

Measure = Callable[[Row], float | None]
"""A value of one episode; None if it has none."""


def score(row: Row) -> float:
    """The game's own score."""
    return float(row["score"])


def normalized_score(row: Row) -> float | None:
    """The score relative to the human score, if the paper has one and the engine is comparable."""
    return None if row["normalized_score"] is None else float(row["normalized_score"])


def tokens(row: Row) -> float:
    """Tokens of all prompts and replies, by our count."""
    return float(row["tokens"]["prompt"] + row["tokens"]["reply"])


def prefix_share(row: Row) -> float | None:
    """The share of an episode's prompt tokens that repeat the beginning of the previous prompt."""
    prompt = row["tokens"]["prompt"]
    return row["tokens"]["prefix"] / prompt if prompt else None


def cost(row: Row) -> float | None:
    """Cost in USD, if the model has a price."""
    return None if row["cost"] is None else float(row["cost"])


MEASURES: Mapping[str, Measure] = {
    "score": score,
    "normalized_score": normalized_score,
    "tokens": tokens,
    "prefix_share": prefix_share,
    "cost": cost,
}
"""The measures by which cells are compared."""


def values(rows: Iterable[Row], measure: Measure) -> list[float]:
    """Return a measure of all episodes that have it."""
    return [value for row in rows if (value := measure(row)) is not None]


def differences(rows: Iterable[Row], reference: Iterable[Row], measure: Measure) -> list[float]:
    """Return measure(row) - measure(its counterpart) for every seed that both sides played, in the order of `rows`."""
    counterparts = {row["seed"]: measure(row) for row in reference}
    pairs = ((measure(row), counterparts.get(row["seed"])) for row in rows)
    return [value - counterpart for value, counterpart in pairs if value is not None and counterpart is not None]


def paired_difference(rows: Iterable[Row], reference: Iterable[Row], measure: Measure) -> MeanEstimate | None:
    """MeanEstimate the mean of the `differences`; its `episodes` are the pairs. None if there is no pair."""
    found = differences(rows, reference, measure)
    return mean_estimate(found) if found else None
