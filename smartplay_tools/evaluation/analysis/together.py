"""Differences that are judged together: intervals of which all hold in 95 of 100 cases.

The level of the intervals is that of max-T: K comparisons are simulated as if nothing differed, normal, with the
correlations that the pairs show, and the least of their K p values has a 5 % quantile. An interval at this level is
narrower than one by Bonferroni (5 % / K) where comparisons have a reference or their worlds in common. Correlations of
few pairs are mostly noise, so they are shrunk towards 0 (Schaefer and Strimmer, 2005); comparisons of different worlds
are independent.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from smartplay_tools.statistics.distributions import Values, t_tail
from smartplay_tools.statistics.intervals import CONFIDENCE, Method, Sample
from smartplay_tools.types.groups import grouped

SEED = 20_240_417
MOST_DF = 60
"""Degrees of freedom with which larger samples are simulated: their p values differ little from those of 60."""

BATCH = 500
"""Simulations at once, few enough for little memory."""


def jointly(samples: Sequence[Sample], simulations: int = 10_000) -> Method:
    """Return the method of intervals of these differences that hold together in 95 of 100 cases."""
    ordered = [_by_unit(sample) for sample in samples if len(sample.values) > 1]
    blocks = grouped(ordered, lambda pair: pair[0]).items()
    largest: dict[int, Values] = {}
    generator = np.random.default_rng(SEED)
    for units, members in blocks:
        df = min(len(units) - 1, MOST_DF)
        own = _largest_t(np.array([values for _, values in members]), df, simulations, generator)
        largest[df] = np.maximum(largest[df], own) if df in largest else own
    least = np.ones(simulations)
    for df, values in largest.items():
        # The 5 % of simulations with the least p values are among the tenth with the largest t of each df.
        ends = np.quantile(values, np.linspace(0.9, 1, 41))
        tails = [2 * t_tail(float(end), df) for end in ends]
        least = np.minimum(least, np.interp(values, ends, tails, left=1.0))
    single = 1 - CONFIDENCE
    level = float(np.quantile(least, single))
    return Method(1 - min(single, max(level, single / max(1, len(samples)))), bootstrap=False)


def bonferroni(compared: int) -> Method:
    """Return the method of intervals of which this many hold together, whatever their correlations."""
    return Method(1 - (1 - CONFIDENCE) / max(1, compared), bootstrap=False)


def _by_unit(sample: Sample) -> tuple[tuple[int, ...], list[float]]:
    """The units of a sample in ascending order, and its values in theirs."""
    units, values = zip(*sorted(zip(sample.units, sample.values, strict=True)), strict=True)
    return units, list(values)


def _largest_t(differences: Values, df: int, simulations: int, generator: np.random.Generator) -> Values:
    """Simulate the largest |t| of differences [comparison, unit] whose means are 0."""
    apart = differences - differences.mean(axis=1, keepdims=True)
    lengths = np.sqrt((apart**2).sum(axis=1, keepdims=True))
    scaled = np.divide(apart, lengths, out=np.zeros_like(apart), where=lengths > 1e-9)  # a constant has no correlation
    noise = _shrinkage(scaled @ scaled.T, df)
    left, sizes, _ = np.linalg.svd(scaled, full_matrices=False)
    own = np.sqrt(np.where(lengths[:, 0] > 1e-9, noise, 1.0))
    shared = math.sqrt(1 - noise) * (left * sizes).T
    largest = []
    for first in range(0, simulations, BATCH):
        shape = (min(BATCH, simulations - first), df + 1)
        drawn = generator.standard_normal((*shape, len(shared))) @ shared
        drawn += own * generator.standard_normal((*shape, len(differences)))
        errors = drawn.std(axis=1, ddof=1) / math.sqrt(df + 1)
        largest.append(np.abs(drawn.mean(axis=1) / errors).max(axis=1))
    return np.concatenate(largest)


def _shrinkage(correlations: Values, df: int) -> float:
    """The share by which correlations are shrunk towards 0: their variance in units of their squares."""
    apart = correlations[~np.eye(len(correlations), dtype=bool)]
    squares = float((apart**2).sum())
    return min(1.0, float(((1 - apart**2) ** 2).sum()) / df / squares) if squares > 0 else 1.0
