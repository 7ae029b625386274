"""Intervals: their coverage, their reproducibility, and their notes if they cannot be estimated."""

from __future__ import annotations

import random

import numpy as np
import pytest
from scipy import stats

from smartplay_tools.evaluation.analysis import intervals
from smartplay_tools.evaluation.analysis.intervals import (
    MeanEstimate,
    mean_estimate,
    mean_estimates,
    weighted_estimates,
)

SCORES = [31.0, 45.0, 44.0, 47.0, 29.0, 46.0, 48.0, 12.0, 45.0, 43.0]


def weighted(samples: list[list[float]], weights: list[float]) -> MeanEstimate:
    (estimate,) = weighted_estimates(samples, [weights])
    return estimate


def test_it_is_the_bca_interval_of_the_literature():
    ours = mean_estimate(SCORES)
    theirs = stats.bootstrap((SCORES,), np.mean, n_resamples=20_000, method="BCa", rng=1).confidence_interval
    assert ours.mean == pytest.approx(np.mean(SCORES))
    assert ours.low == pytest.approx(theirs.low, abs=0.3)
    assert ours.high == pytest.approx(theirs.high, abs=0.3)
    assert ours.mean - ours.low > ours.high - ours.mean  # a few bad episodes: the interval leans towards them


@pytest.mark.parametrize("sizes", [(2,), (40,), (5, 12, 30)])
def test_it_is_scipys_interval_of_the_same_resamples(sizes):
    generator = np.random.default_rng(3)
    samples = [np.sort(generator.integers(0, 5, size=size) / 4) for size in sizes]
    samples = [np.array([*sample[:-1], 1.0]) for sample in samples]  # the largest value is 1
    weights = generator.random(len(sizes))

    def total(*drawn, axis: int):
        return np.round(sum(w * each.mean(axis=axis) for w, each in zip(weights, drawn, strict=True)), intervals.DIGITS)

    theirs = stats.bootstrap(
        samples,
        total,
        n_resamples=intervals.RESAMPLES,
        batch=intervals.BLOCK // sum(sizes),
        vectorized=True,
        rng=np.random.default_rng(intervals.SEED),
    ).confidence_interval
    ours = weighted([sample.tolist() for sample in samples], weights.tolist())
    assert (ours.low, ours.high) == pytest.approx((theirs.low, theirs.high), rel=1e-8)


def test_it_depends_on_the_values_alone():
    shuffled = random.Random(3).sample(SCORES, len(SCORES))
    assert mean_estimate(shuffled) == mean_estimate(SCORES) == mean_estimate(SCORES)


def test_nineteen_of_twenty_intervals_cover_the_truth():
    """Of an exponential distribution with mean 1, which is skewed as scores are."""
    generator = np.random.default_rng(5)
    estimates = [mean_estimate(generator.exponential(size=40).tolist()) for _ in range(200)]
    covered = sum(e.low <= 1 <= e.high for e in estimates)
    assert 0.88 <= covered / len(estimates) <= 0.99


def test_more_episodes_make_it_narrower():
    few, many = mean_estimate(SCORES), mean_estimate(SCORES * 16)
    assert (few.high - few.low) / (many.high - many.low) == pytest.approx(4, abs=0.6)


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([3.0], MeanEstimate(3, None, None, 1, "one episode has no interval")),
        ([1.0, 1.0, 1.0], MeanEstimate(1, 1, 1, 3, "all episodes are equal, so the bootstrap sees no spread")),
    ],
)
def test_where_the_bootstrap_knows_nothing_it_says_so(values, expected):
    assert mean_estimate(values) == expected


def test_what_differs_by_rounding_only_is_equal():
    assert mean_estimate([0.1 + 0.2, 0.3]).note == mean_estimate([0.3, 0.3]).note != mean_estimate([0.3, 0.31]).note


def test_two_episodes_bound_their_own_mean():
    estimate = mean_estimate([0.0, 1.0])
    assert (estimate.low, estimate.high) == (0, 1)


def test_a_sample_larger_than_a_block_is_drawn_in_pieces():
    values = [float(n % 7) for n in range(3_000)]
    estimate = mean_estimate(values)
    assert estimate.high - estimate.low == pytest.approx(2 * 1.96 * np.std(values) / 3_000**0.5, rel=0.05)


def test_samples_are_drawn_apart():
    """Two samples, each constant, have no spread together, however far apart they are."""
    estimate = weighted([[1.0, 1.0], [5.0, 5.0]], [0.25, 0.75])
    assert (estimate.mean, estimate.low, estimate.high, estimate.episodes) == (4, 4, 4, 4)


def test_the_spread_of_a_weighted_sum():
    generator = np.random.default_rng(6)
    samples = [generator.normal(size=200).tolist(), generator.normal(scale=3, size=100).tolist()]
    weights = [0.4, 0.6]
    estimate = weighted(samples, weights)
    variance = sum(w**2 * np.var(s) / len(s) for w, s in zip(weights, samples, strict=True))
    assert estimate.high - estimate.low == pytest.approx(2 * 1.96 * variance**0.5, rel=0.05)


def test_a_lone_episode_in_one_sample_leaves_no_interval_unless_it_counts_for_nothing():
    assert weighted([[1.0, 2.0], [5.0]], [0.5, 0.5]).low is None
    assert weighted([[1.0, 2.0], [5.0]], [1, 0]).low == 1


def test_samples_that_are_estimated_together_are_estimated_as_if_alone():
    samples = [SCORES, [score / 45 for score in SCORES], [1.0, 2.0, 2.0], [7.0], [1e9 * score for score in SCORES]]
    assert mean_estimates(samples) == [mean_estimate(sample) for sample in samples]
