"""The distributions from which intervals and tests follow, and the intervals of shares.

Student's t, central and not. The standard library has the normal distribution only, and NumPy draws from others without
having their probabilities. SciPy has them all, but takes more than 100 MB, which the core needs not otherwise; tests
compare these functions with it (`tests/evaluation/test_intervals.py`) and with statsmodels (`test_oracles.py`).

A share, or the difference of two shares in pairs of episodes, has a distribution that is known but for one number, so
nothing has to be resampled for its interval.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache, lru_cache
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

Values = NDArray[np.float64]

NORMAL = NormalDist()
"""The standard normal distribution."""


def crossing(falling: Callable[[float], float], low: float, high: float, steps: int = 60) -> float:
    """Return where a falling function passes 0 between `low` and `high`."""
    for _ in range(steps):
        middle = (low + high) / 2
        low, high = (middle, high) if falling(middle) > 0 else (low, middle)
    return (low + high) / 2


def beyond(falling: Callable[[float], float]) -> float:
    """Return a power of 2 at which a falling function is no longer positive."""
    high = 1.0
    while falling(high) > 0:
        high *= 2
    return high


def t_tail(t: float, df: float) -> float:
    """The probability that Student's t with `df` degrees of freedom is above `t`, which is at least 0."""
    return 0.5 * _incomplete_beta(df / 2, 0.5, df / (df + t * t))


@lru_cache(maxsize=4096)
def t_quantile(tail: float, df: float) -> float:
    """The value that Student's t exceeds with probability `tail`, at most 0.5."""

    def excess(t: float) -> float:
        return t_tail(t, df) - tail

    return crossing(excess, 0.0, beyond(excess), 80)


def t_power(effect: float, n: int, alpha: float = 0.05) -> float:
    """The power of the two-sided t test of `n` differences whose mean is `effect` standard deviations.

    The noncentral t is integrated over the ratio of the sample's standard deviation to the population's.
    """
    df, shift = n - 1, effect * math.sqrt(n)
    critical = t_quantile(alpha / 2, df)
    spread = 8 / math.sqrt(2 * df)
    low, high = max(0.0, 1 - spread), 1 + spread
    nodes, weights = _legendre()
    ratios = (low + high) / 2 + (high - low) / 2 * nodes
    logs = (df - 1) * np.log(ratios) - df * ratios * ratios / 2
    density = weights * np.exp(logs - logs.max())
    either = [NORMAL.cdf(shift - critical * r) + NORMAL.cdf(-shift - critical * r) for r in ratios.tolist()]
    return float(density @ np.array(either) / density.sum())


@cache
def _legendre() -> tuple[Values, Values]:
    """Places between -1 and 1, and their weights, with which a smooth function is integrated (Gauss and Legendre)."""
    nodes, weights = np.polynomial.legendre.leggauss(100)
    return nodes, weights


def _incomplete_beta(a: float, b: float, x: float) -> float:
    """The regularised incomplete beta function, by its continued fraction (Lentz)."""
    if x <= 0 or x >= 1:
        return float(x >= 1)
    if x > (a + 1) / (a + b + 2):
        return 1 - _incomplete_beta(b, a, 1 - x)
    logs = math.lgamma(a + b) - math.lgamma(a) - math.lgamma(b) + a * math.log(x) + b * math.log1p(-x)
    value, above, below = 1.0, 1.0, 0.0
    for i in range(10_000):
        m = i // 2
        if i == 0:
            term = 1.0
        elif i % 2 == 0:
            term = m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m))
        else:
            term = -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1))
        below = 1 / (1 + term * below)
        above = 1 + term / above
        value *= above * below
        if abs(1 - above * below) < 1e-15:
            break
    return math.exp(logs) / a * (value - 1)


def wilson(successes: int, n: int, confidence: float) -> tuple[float, float]:
    """The score interval of a share (Wilson 1927): on average it covers as often as it says, near 0 and 1 less."""
    z = NORMAL.inv_cdf((1 + confidence) / 2)
    share, square = successes / n, z * z / n
    middle = (share + square / 2) / (1 + square)
    half = math.sqrt(share * (1 - share) * square + square * square / 4) / (1 + square)
    return 0.0 if successes == 0 else middle - half, 1.0 if successes == n else middle + half


@lru_cache(maxsize=4096)
def tango(first: int, second: int, n: int, confidence: float) -> tuple[float, float]:
    """The score interval of a difference of paired shares (Tango 1998).

    In `first` of the `n` pairs only the first episode succeeded, in `second` only the second one.
    """
    z = NORMAL.inv_cdf((1 + confidence) / 2)
    estimate = (first - second) / n

    def score(difference: float) -> float:
        linear = -first - second + (2 * n - first + second) * difference
        constant = -second * difference * (1 - difference)
        root = math.sqrt(max(0.0, linear * linear - 8 * n * constant))
        variance = n * ((root - linear) / (2 * n) + difference * (1 - difference))
        distance = first - second - n * difference
        if variance > 1e-15:
            return distance / math.sqrt(variance)
        return math.copysign(math.inf, distance) if distance else 0.0

    low = -1.0 if first - second == -n else crossing(lambda difference: score(difference) - z, -1, estimate)
    high = 1.0 if first - second == n else crossing(lambda difference: score(difference) + z, estimate, 1)
    return low, high
