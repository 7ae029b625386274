"""The smallest difference that a number of pairs would probably have shown (MDE).

An interval that contains 0 never proves that nothing differs, so an undecided comparison is told with this difference.
"""

from __future__ import annotations

import functools

from smartplay_tools.statistics.distributions import beyond, crossing, t_power
from smartplay_tools.statistics.intervals import CONFIDENCE

POWERS = (0.8, 0.9)


def mde(sd: float, n: int, power: float = POWERS[0], confidence: float = CONFIDENCE) -> float:
    """Return the difference that `n` pairs with this standard deviation show with this power, at a two-sided level."""
    return sd * _effect_seen(n, power, confidence)


@functools.cache
def _effect_seen(n: int, power: float, confidence: float) -> float:
    """The difference that `n` pairs show, in standard deviations: the same for all comparisons of that many pairs."""

    def missing(effect: float) -> float:
        return power - t_power(effect, n, 1 - confidence)

    return crossing(missing, 0.0, beyond(missing), 40)
