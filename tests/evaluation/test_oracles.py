"""The formulas of intervals agree with statsmodels and evalstats, which are independent implementations."""

from __future__ import annotations

import numpy as np
import pytest

from smartplay_tools.statistics.distributions import t_power, tango

power = pytest.importorskip("statsmodels.stats.power")
resampling = pytest.importorskip("evalstats.core.resampling")
pytestmark = pytest.mark.slow  # importing them takes a second


@pytest.mark.parametrize(("effect", "n"), [(0.1, 10), (0.5, 20), (1, 5), (0.2, 200)])
def test_power(effect, n):
    assert t_power(effect, n) == pytest.approx(power.TTestPower().power(effect, n, 0.05), abs=1e-7)


@pytest.mark.parametrize(
    ("first", "second", "n"), [(7, 2, 25), (0, 5, 12), (4, 4, 20), (1, 0, 5), (0, 49, 50), (30, 10, 400)]
)
@pytest.mark.parametrize("confidence", [0.9, 0.95])
def test_intervals_of_paired_shares(first, second, n, confidence):
    """Theirs is a closed form, which can be corrected for continuity; ours is searched for, and is not."""
    one = np.array([1.0] * first + [0.0] * (n - first))
    other = np.array([0.0] * first + [1.0] * second + [0.0] * (n - first - second))
    expected = resampling.tango_scc_paired_ci(one, other, 1 - confidence, c=0)
    assert tango(first, second, n, confidence) == pytest.approx(expected, abs=1e-6)
