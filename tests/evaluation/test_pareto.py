"""The front consists of exactly the points that are not dominated."""

from __future__ import annotations

from hypothesis import given, strategies as st

from smartplay_tools.evaluation.analysis.windows import pareto_front


def test_equal_points_stand_on_the_front_together():
    assert pareto_front([(2, 7), (1, 5), (2, 7)]) == [1, 0, 2]


@given(st.lists(st.tuples(st.integers(0, 6), st.integers(-3, 3))))
def test_the_front_is_what_nothing_dominates(points):
    def dominated(point):
        return any(p[0] <= point[0] and p[1] >= point[1] and p != point for p in points)

    assert sorted(pareto_front(points)) == [at for at, point in enumerate(points) if not dominated(point)]
