"""How often intervals hold the truth, by simulation: samples of 5, 10, 20 and 50 episodes of our own players, and worst
cases.

The truth is the mean of 200 episodes, from which 2,000 samples are drawn. The expected shares are what docs/metrics.md
says, less three standard errors; where a population has rare failures, no interval without bounds does better.
"""

from __future__ import annotations

import numpy as np
import pytest

from smartplay_tools.evaluation.analysis import pairs
from smartplay_tools.evaluation.analysis.intervals import Bounds, Method, Sample, mean_estimates
from tests.evaluation.populations import BANDIT, HANOI, MESSENGER, RPS

pytestmark = pytest.mark.slow

PASSES = Bounds(0, 1, two_valued=True)
REPETITIONS, SIZES = 2_000, (5, 10, 20, 50)


def coverage(population, bounds: Bounds | None = None, method: Method = Method(), seed: int = 0) -> list[float]:  # noqa: B008
    """The share of samples of each size whose interval holds the population's mean."""
    population, generator = np.asarray(population, dtype=float), np.random.default_rng(seed)
    shares = []
    for n in SIZES:
        drawn = generator.choice(population, size=(REPETITIONS, n)).tolist()
        estimates = [
            estimate
            for first in range(0, REPETITIONS, 250)
            for estimate in mean_estimates([Sample(values, bounds) for values in drawn[first : first + 250]], method)
        ]
        truth = population.mean()
        shares.append(np.mean([e.low is None or e.low - 1e-9 <= truth <= e.high + 1e-9 for e in estimates]))
    return shares


@pytest.mark.parametrize(
    ("cell", "least"),
    [
        ((BANDIT, "random", 50), (0.93, 0.93, 0.93, 0.93)),
        ((BANDIT, "rule", 10), (0.75, 0.75, 0.80, 0.88)),  # skewed: a bad start now and then
        ((BANDIT, "rule", 50), (0.70, 0.68, 0.72, 0.80)),  # rare failures
        ((RPS, "rule", 50), (0.80, 0.85, 0.89, 0.92)),
        ((HANOI, "random", 50), (0.93, 0.93, 0.93, 0.93)),
        ((MESSENGER, "random", 3), (0.93, 0.93, 0.92, 0.93)),
        ((MESSENGER, "rule", 0), (0.93, 0.93, 0.93, 0.88)),
    ],
)
def test_scores_of_one_cell(played, cell, least):
    sample = pairs.sample(played[cell], pairs.score)
    assert np.all(np.array(coverage(sample.values, sample.bounds)) >= least)


@pytest.mark.parametrize(
    ("cell", "other", "least"),
    [
        ((BANDIT, "rule", 50), (BANDIT, "random", 50), (0.91, 0.91, 0.91, 0.91)),
        ((BANDIT, "rule", 10), (BANDIT, "rule", 50), (0.93, 0.93, 0.93, 0.90)),
        ((RPS, "rule", 10), (RPS, "rule", 50), (0.91, 0.93, 0.93, 0.92)),
        ((MESSENGER, "rule", 0), (MESSENGER, "rule", 3), (0.93, 0.93, 0.93, 0.88)),
    ],
)
def test_differences_in_pairs(played, cell, other, least):
    paired = pairs.pairs(played[cell], played[other])
    sample = pairs.difference_sample(paired, pairs.score)
    assert np.all(np.array(coverage(sample.values, sample.bounds)) >= least)


@pytest.mark.parametrize("share", [0.02, 0.1, 0.5, 0.98])
def test_shares(share):
    """Wilson's interval covers 95 % on average and less near 0 and 1; the exact one never less."""
    population = np.arange(200) < round(200 * share)
    assert min(coverage(population, PASSES)) >= 0.88
    assert min(coverage(population, PASSES, Method(exact=True))) >= 0.935


@pytest.mark.parametrize(("wins", "losses"), [(0.0, 0.02), (0.02, 0.02), (0.3, 0.1), (0.5, 0.5), (0.0, 0.98)])
def test_differences_of_shares_in_pairs(wins, losses):
    counts = [round(200 * wins), round(200 * losses)]
    population = np.repeat([1.0, -1.0, 0.0], [*counts, 200 - sum(counts)])
    assert min(coverage(population, PASSES.of_differences)) >= (0.92 if losses < 0.9 else 0.88)


def test_what_is_nearly_always_equal():
    """One episode in 200 fails totally: equal samples have the interval that their number gives, which holds it."""
    population = np.repeat([1.0, -1.0], [199, 1])
    assert min(coverage(population, Bounds(-1, 1))) >= 0.935
    assert min(coverage(np.ones(200), Bounds(-1, 1))) == 1
