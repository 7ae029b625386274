"""What is measured of an episode, and the bounds of a sample of it."""

from __future__ import annotations

import pytest

from smartplay_tools.evaluation.analysis import pairs
from smartplay_tools.statistics.intervals import mean_estimate
from tests.evaluation.window_rows import row


def test_tokens_are_never_negative_and_have_no_upper_limit():
    few = pairs.sample([row(seed=0, tokens=100), row(seed=1, tokens=6_000), row(seed=2, tokens=200)], pairs.tokens)
    estimate = mean_estimate(few.values, few.bounds)
    assert (estimate.low, estimate.high > 6_000) == (0, True)
    equal = pairs.sample([row(seed=seed, tokens=1_000) for seed in range(3)], pairs.tokens)
    assert mean_estimate(equal.values, equal.bounds).high is None


def test_measures_of_an_episode():
    one = row(score=40, tokens=400, cost=0.25)
    one["tokens"] |= {"reply": 20, "prefix": 100}
    measures = {name: measure(one) for name, measure in pairs.MEASURES.items()}
    assert measures == {
        "score": 40,
        "normalized_score": pytest.approx(40 / 45),
        "reward": 40,
        "steps": 50,
        "tokens": 420,
        "prefix_share": 0.25,
        "cost": 0.25,
        "way_to_best": None,
    }
    assert pairs.prefix_share(row(tokens=0)) is None, "without prompts"
    assert pairs.values([one, row()], pairs.cost) == [0.25], "without a price"
