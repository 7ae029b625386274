"""The area under score against the cap on prompts: a worked example, what is refused, and its coverage."""

from __future__ import annotations

import numpy as np
import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.analysis.area import areas, areas_table
from smartplay_tools.evaluation.analysis.figures import areas_under_curves
from tests.evaluation.window_rows import row

CAPS = (250, 500, 1_000, None)


def sweep(scores, *, seeds=20, chance=10.0, peak=2_000, seed=0, **facts):
    """Rows of `rule` with a mean score under each cap, and of `random`."""
    generator = np.random.default_rng(seed)
    luck = generator.normal(0, 2, size=seeds)
    rows = [
        row(seed=at, score=mean + luck[at], prompt_tokens=cap, peak_prompt_tokens=peak if cap is None else cap, **facts)
        for cap, mean in zip(CAPS, scores, strict=True)
        if mean is not None
        for at in range(seeds)
    ]
    noise = generator.normal(0, 2, size=seeds)
    return rows + [row(seed=at, score=chance + noise[at], player="random") for at in range(seeds)]


def test_a_worked_example():
    """Caps an octave apart: the ends count half, the shares of the gain are 0, 0.5, 1 and 1."""
    (area,) = areas(sweep([10, 25, 40, 40], seeds=2_000))
    assert area.caps == CAPS
    assert area.area == pytest.approx((0 / 2 + 0.5 + 1 + 1 / 2) / 3, abs=0.01)
    assert area.low < area.area < area.high


def test_no_cap_costs_anything_is_one():
    (area,) = areas(sweep([40, 40, 40, 40]))
    assert (area.area, area.low, area.high) == pytest.approx((1, 1, 1))


def test_a_cap_that_is_too_small_for_one_strategy_counts_as_random():
    with_notes = [r for r in sweep([None, 25, 40, 40]) if r["player"] != "random"]
    for r in with_notes:
        r["budget"] = r["budget"] | {"notes_tokens": 200}
    rows = sweep([10, 25, 40, 40]) + with_notes
    dropping, notes = areas(rows)
    assert notes.infeasible == (250,)
    assert notes.difference == pytest.approx((notes.area - dropping.area, *notes.difference[1:]))
    assert "250 too small, counted as random" in " ".join(areas_table([dropping, notes]).notes)


@pytest.mark.parametrize(
    ("rows", "reason"),
    [
        (sweep([10, 25, 40, 40], chance=40), "not shown to differ from random"),
        (sweep([10, 25, None, 40]), "fewer than 4 caps"),
        (sweep([10, 25, 40, 40], peak=900), "larger than the largest cap"),
        ([r for r in sweep([10, 25, 40, 40]) if r["player"] != "random"], "random was not played"),
    ],
)
def test_what_has_no_area_says_why(rows, reason):
    (area,) = areas(rows)
    assert area.area is None
    assert reason in area.reason


def test_a_single_cap_is_not_a_curve():
    assert areas([row(seed=0, score=1.0)]) == []


def test_differences_hold_together_in_wider_intervals_and_the_figure_has_a_row_for_each(tmp_path):
    rows = sweep([10, 25, 40, 40])
    for strategy, scores in (("notes_tokens", [10, 30, 40, 40]), ("first_turns", [10, 20, 40, 40])):
        own = [r for r in sweep(scores) if r["player"] != "random"]
        rows += [{**r, "budget": r["budget"] | {strategy: 200}} for r in own]
    first, *others = areas(rows)
    assert first.together is None
    for each in others:
        assert each.together[0] == each.difference[0]
        assert each.together[1] <= each.difference[1] < each.difference[2] <= each.together[2]
    # One difference alone has the interval that holds by itself, and one of many a wider one.
    alone, many = (areas(rows, compared=compared)[1].together for compared in (1, 100))
    assert alone == others[0].difference
    assert many[1] < others[0].together[1] < others[0].together[2] < many[2]
    (panel,) = areas_under_curves([first, *others]).axes
    assert [label.get_text() for label in panel.get_yticklabels()] == ["dropping", "notes <= 200", "first turns 200"]
    with pytest.raises(sp.InvalidArgumentError, match="nothing to draw"):
        areas_under_curves([])


def test_slack_is_part_of_the_name_of_a_curve():
    rows = sweep([10, 25, 40, 40])
    for r in [r for r in rows if r["player"] != "random"]:
        r["budget"] = r["budget"] | {"slack": 0.5}
    (area,) = areas(rows)
    assert area.name == "rule, dropping, slack 0.5"
