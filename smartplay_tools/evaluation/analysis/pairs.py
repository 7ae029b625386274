"""The comparison of two cells by pairs of episodes with the same seed.

The seeds of a run are paired: trial i of a game has the same seed in every cell. The world of a seed (which machine
pays, what the opponent prefers, where the cows are) is therefore the same on both sides of a difference and cancels
out, so that far fewer episodes are needed to show whether a smaller window costs anything.

The interval of a mean difference is computed by `intervals`, with the differences as the sample. An episode whose
counterpart is missing (it failed, or was not played yet) is in no pair. Where trials carry something over, on either
side of a pair, the sample is that of the means of chains: `records.rows.unit_of`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace

from smartplay_tools.games.game_registry import Scoring
from smartplay_tools.games.specs import GAMES
from smartplay_tools.records.rows import Row, mean_score, scoring_of, unit_of
from smartplay_tools.statistics.intervals import USUAL, Bounds, MeanEstimate, Method, Sample, mean_estimate
from smartplay_tools.types.groups import grouped

__all__ = ["MEASURES", "differences", "paired_difference"]

FAMILIES_WITHOUT_OBJECTIVE = ("bandit", "rock_paper_scissors", "crafter")
"""Games that cannot be completed, so they have no completion rate (paper, section 4.2)."""


CONTROLS = ("random", "blind", "first", "always")
"""Players that do not read their prompts: they show what chance and fixed actions score, and differ from nothing."""


def is_control(player: str) -> bool:
    """Return whether a player, as `random` or `blind:RUN`, is a control."""
    return player.partition(":")[0] in CONTROLS


Measure = Callable[[Row], float | None]
"""A value of one episode; None if it has none."""


def score(row: Row) -> float:
    """The game's own score; after an early end the one that means use, `records.rows.mean_score`."""
    return mean_score(row)


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


def reward(row: Row) -> float:
    """The points of the game, which its player was told: the sum of its rewards."""
    return float(row["reward"])


def steps(row: Row) -> float:
    """The steps that were played."""
    return float(row["steps"])


def way_to(best: str) -> Measure:
    """Return the measure of the share of the way from dropping to a best choice of `records.best_choices`.

    An episode has none where its game does not tell, or where the best choice wins nothing.
    """

    def share(row: Row) -> float | None:
        scores = row.get("best")
        gain = scores[best] - scores["dropping"] if scores else 0
        return (mean_score(row) - scores["dropping"]) / gain if scores and gain > 1e-9 else None

    return share


MEASURES: Mapping[str, Measure] = {
    "score": score,
    "normalized_score": normalized_score,
    "reward": reward,
    "steps": steps,
    "tokens": tokens,
    "prefix_share": prefix_share,
    "cost": cost,
    "way_to_best": way_to("with_return"),
}
"""The measures by which cells are compared."""


def bounds_of(measure: Measure, scoring: Scoring | None, calls: int | None = None) -> Bounds | None:
    """Return what a measure can be in a setting in so many calls, if that is declared; it need not be known."""
    if measure in (prefix_share, completion):
        return Bounds(0, 1, two_valued=measure is completion)
    if measure in (tokens, cost):
        return Bounds(0, math.inf)
    if scoring is None or measure not in (score, normalized_score, reward, steps):
        return None
    most = scoring.rollout if calls is None else min(scoring.rollout, calls)
    if measure is steps:
        return Bounds(0, most)
    ends = scoring.points_in(most) if measure is reward else scoring.bounds_in(most)
    low, high = (None, None) if ends is None else map(scoring.normalize, ends) if measure is normalized_score else ends
    return None if low is None or high is None else Bounds(low, high, scoring.two_valued and measure is not reward)


def values(rows: Iterable[Row], measure: Measure) -> list[float]:
    """Return a measure of all episodes that have it."""
    return [value for row in rows if (value := measure(row)) is not None]


def completion(row: Row) -> float | None:
    """1 if the objective was reached, otherwise 0; None for games that have no objective."""
    spec = GAMES.get(row["game"])
    return None if spec is not None and spec.family in FAMILIES_WITHOUT_OBJECTIVE else float(row["completed"])


def _bounds_in(measure: Measure, row: Row) -> Bounds | None:
    """What a measure can be in the setting of a row and under its cap on calls."""
    return bounds_of(measure, scoring_of(row), row["budget"].get("tool_calls"))


def sample(rows: Sequence[Row], measure: Measure, bounds: Bounds | None = None) -> Sample:
    """Return a measure of the episodes of a cell, or of its worlds or chains if these have several episodes.

    `bounds` are those of the measure, where it is not one of the game's.
    """
    measured = [(unit_of(row), value) for row in rows if (value := measure(row)) is not None]
    return _of_units(measured, bounds or (_bounds_in(measure, rows[0]) if rows else None))


def _of_units(measured: Sequence[tuple[int, float]], bounds: Bounds | None) -> Sample:
    """Repeats of a world, or trials of a chain, are not independent, so the means of worlds or chains are used."""
    units = grouped(measured, lambda pair: pair[0])
    means = [math.fsum(value for _, value in members) / len(members) for members in units.values()]
    if len(units) < len(measured) and bounds is not None:
        bounds = replace(bounds, two_valued=False)
    return Sample(means, bounds, list(units))


def cut_share(rows: Sequence[Row]) -> float | None:
    """Return the share of the tool results of a cell that were cut to their cap; None without a tool call."""
    calls = sum(row["tool_calls"] for row in rows)
    return sum(row["cut_results"] for row in rows) / calls if calls else None


def samples(rows: Sequence[Row], measures: Mapping[str, Measure] = MEASURES) -> dict[str, Sample]:
    """Return these measures of the episodes of a cell."""
    return {name: sample(rows, measure) for name, measure in measures.items()}


Pair = tuple[Row, Row]
"""An episode and its counterpart."""


def pairs(rows: Iterable[Row], reference: Iterable[Row]) -> list[Pair]:
    """Return the episodes that both sides played, those of the same seed and trial, in the order of `rows`."""
    counterparts = {(row["seed"], row["trial"]): row for row in reference}
    keyed = {(row["seed"], row["trial"]): row for row in rows}
    return [(row, counterparts[key]) for key, row in keyed.items() if key in counterparts]


def are_identical(paired: Sequence[Pair]) -> bool:
    """Return whether every prompt and every reply is equal on both sides of all pairs, as far as rows say so."""
    plays = [[row.get("play_sha256") for row in pair] for pair in paired]
    return bool(plays) and all(first == second is not None for first, second in plays)


def difference_sample(paired: Sequence[Pair], measure: Measure) -> Sample:
    """Return measure(row) - measure(its counterpart) of the pairs that have it."""
    measured = ((unit_of(row, counterpart), measure(row), measure(counterpart)) for row, counterpart in paired)
    unit_differences = [
        (unit, value - other) for unit, value, other in measured if value is not None and other is not None
    ]
    own, other = (_bounds_in(measure, row) for row in paired[0]) if paired else (None, None)
    return _of_units(unit_differences, None if own is None or other is None else own.less(other))


def difference_samples(paired: Sequence[Pair]) -> dict[str, Sample]:
    """Return the differences of all measures."""
    return {name: difference_sample(paired, measure) for name, measure in MEASURES.items()}


def differences(rows: Iterable[Row], reference: Iterable[Row], measure: Measure) -> Sequence[float]:
    """Return measure(row) - measure(its counterpart) for every pair, in the order of `rows`."""
    return difference_sample(pairs(rows, reference), measure).values


def paired_difference(
    rows: Iterable[Row], reference: Iterable[Row], measure: Measure, method: Method = USUAL
) -> MeanEstimate | None:
    """Estimate the mean of the `differences`; its `episodes` are the pairs. None if there is no pair."""
    differing = difference_sample(pairs(rows, reference), measure)
    return mean_estimate(differing.values, differing.bounds, method) if differing.values else None
