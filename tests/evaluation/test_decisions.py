"""The smallest difference that a number of pairs shows."""

from __future__ import annotations

import pytest

from smartplay_tools.evaluation.analysis.decisions import mde


@pytest.mark.parametrize(("n", "expected"), [(5, 1.68), (10, 1.00), (20, 0.66), (50, 0.40), (100, 0.28), (200, 0.20)])
def test_the_smallest_difference_that_is_seen(n, expected):
    assert mde(1.0, n) == pytest.approx(expected, abs=0.005)
