"""Intervals: their coverage, their reproducibility, and their notes if they cannot be estimated."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

from smartplay_tools.statistics import intervals
from smartplay_tools.statistics.intervals import (
    Bounds,
    MeanEstimate,
    Sample,
    mean_estimate,
    mean_estimates,
    weighted_estimates,
)

PASSES = Bounds(0, 1, two_valued=True)
SCORES = [31.0, 45.0, 44.0, 47.0, 29.0, 46.0, 48.0, 12.0, 45.0, 43.0]


def weighted(samples: list[list[float]], weights: list[float]) -> MeanEstimate:
    (estimate,) = weighted_estimates(samples, [weights])
    return estimate


def expanded(n: int, confidence: float = 0.95) -> float:
    """The level at which a bootstrap interval of `n` normal values is as wide as Student's."""
    return 2 * scipy.stats.norm.cdf(scipy.stats.t.ppf((1 + confidence) / 2, n - 1) * (n / (n - 1)) ** 0.5) - 1


def test_each_end_is_the_wider_of_students_and_the_bootstraps():
    ours = mean_estimate(SCORES)
    bootstrap = scipy.stats.bootstrap(
        (SCORES,), np.mean, n_resamples=20_000, method="BCa", rng=1, confidence_level=expanded(10)
    ).confidence_interval
    student = scipy.stats.t.interval(0.95, 9, np.mean(SCORES), scipy.stats.sem(SCORES))
    assert ours.mean == pytest.approx(np.mean(SCORES))
    assert ours.low == pytest.approx(bootstrap.low, abs=2)  # a few bad episodes: the bootstrap leans towards them
    assert bootstrap.low < student[0]
    assert ours.high == pytest.approx(student[1])
    assert student[1] > bootstrap.high


SKEWED = [316.0, 457.0, 585.0, 661.0, 888.0, 1196.0, 1906.0, 1967.0, 2077.0, 16932.0]


@pytest.mark.parametrize(
    ("samples", "weights"),
    [
        ([SKEWED], [1.0]),
        ([[0.0, 0.25, 0.5, 1.0, 1.0], [0.5] * 7 + [1.0] * 5, sorted(np.arange(30) % 7)], [0.7, 0.2, 0.4]),
    ],
)
def test_the_bootstrap_is_that_of_many_resamples(samples, weights):
    """Ten thousand resamples of ten skewed scores leave an end uncertain by a seventh of the width."""

    def total(*drawn, axis: int):
        return sum(weight * each.mean(axis=axis) for weight, each in zip(weights, drawn, strict=True))

    theirs = scipy.stats.bootstrap(
        samples, total, n_resamples=200_000, batch=20_000, vectorized=True, rng=1,
        confidence_level=expanded(min(map(len, samples))),
    ).confidence_interval  # fmt: skip
    used = tuple((tuple(map(float, sample)), weight) for sample, weight in zip(samples, weights, strict=True))
    ends = intervals._bootstrapped(used, intervals._expanded(min(map(len, samples)), 0.95))
    assert ends == pytest.approx((theirs.low, theirs.high), abs=0.02 * (theirs.high - theirs.low))


@pytest.mark.parametrize(("successes", "n"), [(0, 20), (3, 7), (20, 20), (99, 100), (5_000, 10_000)])
def test_shares_have_scipys_intervals(successes, n):
    values = [1.0] * successes + [0.0] * (n - successes)
    ours = mean_estimate(values, PASSES)
    theirs = scipy.stats.binomtest(successes, n).proportion_ci(method="wilson")
    assert (ours.low, ours.high) == pytest.approx((theirs.low, theirs.high), abs=1e-9)


def test_equal_scores_have_the_interval_that_their_number_alone_gives():
    """With 20 equal episodes, at most 14 % of all may differ, and by the whole range at most."""
    estimate = mean_estimate([1.0] * 20, Bounds(-1, 1))
    assert estimate.low == pytest.approx(1 - 2 * (1 - 0.05 ** (1 / 20)))
    assert estimate.high == 1
    difference = mean_estimate([0.0] * 20, Bounds(-1, 1).of_differences)
    assert (difference.low, difference.high) == pytest.approx((-0.28, 0.28), abs=0.005)


def test_a_declaration_that_a_score_contradicts_counts_as_none():
    assert mean_estimate([3.0, 3.0, 3.0], Bounds(0, 1)).low is None
    assert mean_estimate([0.0, 0.5, 1.0], PASSES) == mean_estimate([0.0, 0.5, 1.0])


def test_an_interval_ends_where_the_mean_cannot_be():
    assert mean_estimate([0.0, 1.0], Bounds(0, 1)).high == 1
    assert mean_estimate([0.0, 1.0]).high == pytest.approx(scipy.stats.t.interval(0.95, 1, 0.5, 0.5)[1])


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([3.0], MeanEstimate(3, None, None, 1, "one episode has no interval")),
        ([1.0] * 20, MeanEstimate(1, None, None, 20, "all 20 equal; up to 14% of all episodes may differ", True)),
        ([1.0] * 999, MeanEstimate(1, None, None, 999, "all 999 equal; up to 0.3% of all episodes may differ", True)),
    ],
)
def test_where_nothing_is_known_it_says_so(values, expected):
    assert mean_estimate(values) == expected


def test_what_differs_by_rounding_only_is_equal():
    assert mean_estimate([0.1 + 0.2, 0.3]).note == mean_estimate([0.3, 0.3]).note != mean_estimate([0.3, 0.31]).note


def test_the_sign_test_of_equal_differences_has_two_sides():
    assert [mean_estimate([2.0] * pairs).sign_p for pairs in (2, 6)] == [1 / 2, 1 / 32]
    assert mean_estimate([0.0] * 6).sign_p is mean_estimate([1.0, 2.0]).sign_p is None


def test_a_lone_episode_in_one_sample_leaves_no_interval_unless_it_counts_for_nothing():
    assert weighted([[1.0, 2.0], [5.0]], [0.5, 0.5]).low is None
    assert weighted([[1.0, 2.0], [5.0]], [1, 0]).low < 1


def test_samples_that_are_estimated_together_are_estimated_as_if_alone():
    samples = [SCORES, [score / 45 for score in SCORES], [1.0, 2.0, 2.0], [7.0], [1e9 * score for score in SCORES]]
    assert mean_estimates([Sample(values) for values in samples]) == [mean_estimate(sample) for sample in samples]
