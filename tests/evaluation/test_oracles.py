"""The formulas of intervals agree with statsmodels, which is an independent implementation."""

from __future__ import annotations

import pytest

from smartplay_tools.evaluation.analysis.distributions import t_power
from smartplay_tools.evaluation.analysis.shares import clopper_pearson, wilson

proportion = pytest.importorskip("statsmodels.stats.proportion")
power = pytest.importorskip("statsmodels.stats.power")


@pytest.mark.parametrize(("successes", "n"), [(0, 20), (3, 7), (20, 20), (99, 100), (5_000, 10_000)])
def test_intervals_of_shares(successes, n):
    for ours, theirs in ((wilson, "wilson"), (clopper_pearson, "beta")):
        expected = proportion.proportion_confint(successes, n, method=theirs)
        assert ours(successes, n, 0.95) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(("effect", "n"), [(0.1, 10), (0.5, 20), (1, 5), (0.2, 200)])
def test_power(effect, n):
    assert t_power(effect, n) == pytest.approx(power.TTestPower().power(effect, n, 0.05), abs=1e-7)
