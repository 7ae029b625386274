"""Intervals of shares: of the episodes that succeed, and of the difference between two shares in pairs of episodes.

What is either 0 or 1 has a distribution that is known but for one number, so nothing has to be resampled.
"""

from __future__ import annotations

import math
from functools import lru_cache

from smartplay_tools.evaluation.analysis.distributions import NORMAL, binomial_at_most, crossing


def wilson(successes: int, n: int, confidence: float) -> tuple[float, float]:
    """The score interval of a share (Wilson 1927): on average it covers as often as it says, near 0 and 1 less."""
    z = NORMAL.inv_cdf((1 + confidence) / 2)
    share, square = successes / n, z * z / n
    middle = (share + square / 2) / (1 + square)
    half = math.sqrt(share * (1 - share) * square + square * square / 4) / (1 + square)
    return 0.0 if successes == 0 else middle - half, 1.0 if successes == n else middle + half


@lru_cache(maxsize=4096)
def clopper_pearson(successes: int, n: int, confidence: float) -> tuple[float, float]:
    """The exact interval of a share (Clopper and Pearson 1934): it covers at least as often as it says."""
    tail = (1 - confidence) / 2
    low = crossing(lambda share: tail - 1 + binomial_at_most(successes - 1, n, share), 0, 1)
    high = crossing(lambda share: binomial_at_most(successes, n, share) - tail, 0, 1)
    return 0.0 if successes == 0 else low, 1.0 if successes == n else high


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
