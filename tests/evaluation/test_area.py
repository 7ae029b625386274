"""The area under score against the cap on prompts: a worked example, what is refused, and its coverage."""

from __future__ import annotations

import numpy as np
import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.analysis.area import areas, areas_table
from smartplay_tools.evaluation.analysis.figures.curves import areas_under_curves
from smartplay_tools.evaluation.analysis.names import check_distinct
from tests.evaluation.window_rows import row

CAPS = (250, 500, 1_000, 2_000)


def sweep(scores, *, seeds=20, chance=10.0, full=40.0, seed=0, **facts):
    """Rows of `rule` with a mean score under each cap and without one, and of `random`."""
    generator = np.random.default_rng(seed)
    luck = generator.normal(0, 2, size=seeds)
    rows = [
        row(seed=at, score=mean + luck[at], prompt_tokens=cap, **facts)
        for cap, mean in zip((*CAPS, None), (*scores, full), strict=True)
        if mean is not None
        for at in range(seeds)
    ]
    noise = generator.normal(0, 2, size=seeds)
    return rows + [row(seed=at, score=chance + noise[at], player="random") for at in range(seeds)]


def budgets(rows, **fields):
    """The rows of `rule`, under another budget."""
    return [{**r, "budget": r["budget"] | fields} for r in rows if r["player"] == "rule"]


RANDOM = [r for r in sweep([40] * 4) if r["player"] == "random"]
CAPPED = [row(seed=at, score=45.0 + at, history=50, prompt_tokens=500) for at in range(20)]
"""The widest window, under a cap."""


def test_a_worked_example():
    """Caps an octave apart: the ends count half, the shares of the gain are 0, 0.5, 1 and 1."""
    (area,) = areas(sweep([10, 25, 40, 40], seeds=2_000))
    assert area.caps == CAPS
    assert area.area == pytest.approx((0 / 2 + 0.5 + 1 + 1 / 2) / 3, abs=0.01)
    assert area.low < area.area < area.high


def test_no_cap_costs_anything_is_one():
    (area,) = areas(sweep([40, 40, 40, 40]))
    assert (area.area, area.low, area.high) == pytest.approx((1, 1, 1))


def test_a_cap_that_is_too_small_for_one_strategy_counts_as_an_episode_without_a_step():
    with_notes = [r for r in sweep([None, 25, 40, 40]) if r["player"] != "random"]
    for r in with_notes:
        r["budget"] = r["budget"] | {"notes_tokens": 200}
    rows = sweep([10, 25, 40, 40]) + with_notes
    dropping, notes = areas(rows)
    assert notes.infeasible == (250,)
    assert notes.difference == pytest.approx((notes.area - dropping.area, *notes.difference[1:]))
    assert "250 too small, counted as 0" in " ".join(areas_table([dropping, notes]).notes)


@pytest.mark.parametrize(
    ("rows", "reason"),
    [
        (sweep([10, 25, 40, 40], chance=40), "not shown to differ from random"),
        (sweep([10, None, None, 40]), "fewer than 3 caps"),
        (sweep([10, 25, 40, 40], full=None), "the widest window has a cap"),
        ([r for r in sweep([10, 25, 40, 40]) if r["player"] != "random"], "random was not played"),
        (budgets(sweep([10, 25, 40, 40]), history=2) + CAPPED + RANDOM, "the widest window has a cap on prompts"),
        (
            sweep([10, 25, 40, 40]) + budgets(sweep([0, 0, 0, 0]), result_tokens=77),
            "cells under the same cap on prompts differ in their cap on results",
        ),
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


def test_histories_have_names_that_differ_and_one_yardstick():
    """A history of 2 costs this player all that caps can cost, so no cap costs it more: that is not an area of 1."""
    rows = budgets(sweep([25, 25, 25, 25]), history=2) + budgets(sweep([25, 32.5, 40, 40]), history=50)
    short, long = areas(rows + RANDOM)
    assert (short.name, long.name) == ("rule, history 2, dropping", "rule, history 50, dropping")
    assert short.area == pytest.approx(0.5, abs=0.05)
    assert long.area == pytest.approx((0.5 / 2 + 0.75 + 1 + 1 / 2) / 3, abs=0.05)


@pytest.mark.parametrize(
    ("facts", "name"),
    [
        ({"manual": "pinned"}, "rule, dropping, manual pinned"),
        ({"player_options": {"words": False}}, "rule, dropping, words=false"),
        ({"options": {"machines": 3}}, "rule, dropping, machines=3"),
        ({"tokenizer": "cl100k_base"}, "rule, dropping, tokenizer cl100k_base"),
    ],
)
def test_curves_without_a_common_yardstick_are_named_and_have_no_area(facts, name):
    rows = sweep([10, 25, 40, 40])
    other = [{**r, **facts} for r in rows if r["player"] == "rule"]
    first, second = areas(rows + other)
    assert second.name == name != first.name
    assert (first.area, second.area) == (None, None)
    assert first.reason == "several cells have the widest window, so there is no one score that is 1"


def test_a_cap_on_calls_is_named_and_is_not_a_wider_window():
    rows = sweep([10, 25, 40, 40])
    assert [each.name for each in areas(rows + budgets(rows, tool_calls=9))] == [
        "rule, dropping, calls <= 216",
        "rule, dropping, calls <= 9",
    ]


def test_two_lines_of_one_name_are_a_bug():
    with pytest.raises(AssertionError, match="same name"):
        check_distinct(["rule, dropping", "rule, notes <= 200", "rule, dropping"])
