"""Episodes are compared with those of the same seed, and with no others."""

from __future__ import annotations

import numpy as np
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


def test_what_all_seeds_share_cancels_out():
    """Seeds differ by 100 points, and the cost is 1 or 2 in each, which only a paired comparison can show."""
    luck = np.random.default_rng(0).normal(0, 100, 40)
    full = [row(seed=seed, score=float(points)) for seed, points in enumerate(luck)]
    small = [row(seed=seed, score=float(points) - 1 - seed % 2) for seed, points in enumerate(luck)]
    difference = pairs.paired_difference(small, full, pairs.score)
    assert difference.mean == pytest.approx(-1.5)
    assert -1.7 < difference.low < difference.high < -1.3
    alone = mean_estimate(pairs.values(full, pairs.score))
    assert alone.high - alone.low > 40


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


def test_an_episode_without_prompts_or_price_has_no_share_and_no_cost():
    one = row(tokens=0)
    assert pairs.prefix_share(one) is None
    assert pairs.cost(one) is None
    assert pairs.values([one], pairs.cost) == []
