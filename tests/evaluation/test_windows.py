"""Cells are compared with the reference of their own family."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given, strategies as st

from smartplay_tools.evaluation.analysis.grouping import labels
from smartplay_tools.evaluation.analysis.names import series_name
from smartplay_tools.evaluation.analysis.together import jointly
from smartplay_tools.evaluation.analysis.window_tables import windows_table
from smartplay_tools.evaluation.analysis.windows import as_row, compare_windows, pareto_front
from smartplay_tools.statistics.intervals import Sample
from tests.evaluation.window_rows import row

RPS = "RockPaperScissorBasic-v0"


def cell(scores, **facts):
    return [row(seed=seed, score=score, **facts) for seed, score in enumerate(scores)]


def by_window(comparisons):
    return {tuple(c.cell.budget[name] for name in ("history", "prompt_tokens", "slack")): c for c in comparisons}


def test_the_cell_that_shows_most_is_full_context():
    windows = [(5, 500, 0.0), (50, 500, 0.0), (None, None, 0.5), (None, None, 0.0), (10_000, None, 0.0)]
    rows = [r for h, p, s in windows for r in cell([1, 2], history=h, prompt_tokens=p, slack=s)]
    comparisons = by_window(compare_windows(rows))
    assert [window for window, c in comparisons.items() if c.is_reference] == [(None, None, 0.0)]
    assert {tuple(c.reference.budget.values()) for c in comparisons.values()} == {
        tuple(comparisons[None, None, 0.0].cell.budget.values())
    }


def test_means_and_differences_of_a_worked_example():
    rows = cell([30, 40, 50], history=1, tokens=100) + cell([40, 44, 48], history=None, tokens=400)
    small, full = compare_windows(rows)
    assert small.episodes == 3
    assert small.means["score"].mean == 40
    assert small.means["tokens"].mean == 100
    assert small.means["prefix_share"].mean == 0.5
    assert small.differences["score"].mean == pytest.approx((-10 - 4 + 2) / 3)
    assert small.differences["tokens"].mean == -300
    assert small.differences["prefix_share"].mean == 0
    assert "cost" not in small.means
    assert full.differences == {}


def test_players_games_manuals_and_options_are_families_of_their_own():
    apart = [{}, {"player": "random"}, {"game": RPS}, {"manual": "pinned"}, {"player_options": {"base_url": "here"}}]
    rows = [r for facts in apart for history in (1, 50) for r in cell([1, 2], history=history, **facts)]
    assert [c.is_reference for c in compare_windows(rows)] == [False, True] * len(apart)


def test_a_cap_on_results_that_follows_from_the_prompt_is_no_difference():
    narrow = cell([1], prompt_tokens=500, result_tokens=60, manual_tokens=80)
    wide = cell([2], prompt_tokens=1000, result_tokens=180, manual_tokens=240)
    assert [c.is_reference for c in compare_windows(narrow + wide)] == [False, True]


def test_along_slack_alone_every_window_has_its_own_reference():
    rows = [r for h in (5, 50) for s in (0.0, 0.5) for r in cell([h, h - 2 * s], history=h, slack=s)]
    comparisons = by_window(compare_windows(rows, along=("slack",)))
    assert [window for window, c in comparisons.items() if c.is_reference] == [(5, None, 0.0), (50, None, 0.0)]
    assert comparisons[5, None, 0.5].differences["score"].mean == -0.5


def test_the_front_is_one_for_all_players_of_a_game():
    rows = [
        *cell([30, 30], tokens=100, history=1),
        *cell([40, 40], tokens=300, history=50),
        *cell([35, 35], tokens=300, history=50, player="random"),
        *cell([1, 1], tokens=900, game=RPS),  # alone in its game
    ]
    assert [c.on_token_front for c in compare_windows(rows)] == [True, True, False, True]


@given(st.lists(st.tuples(st.integers(0, 6), st.integers(-3, 3))))
def test_the_front_is_what_nothing_dominates(points):
    def dominated(point):
        return any(p[0] <= point[0] and p[1] >= point[1] and p != point for p in points)

    assert sorted(pareto_front(points)) == [at for at, point in enumerate(points) if not dominated(point)]


def test_a_front_of_cost_needs_the_price_of_every_episode():
    priced = cell([30, 30], history=1, cost=0.01) + cell([20, 20], history=2, cost=0.02)
    assert [c.on_cost_front for c in compare_windows(priced)] == [True, False]
    priced[0]["cost"] = None
    assert [c.on_cost_front for c in compare_windows(priced)] == [None, None]


def test_repeats_of_a_world_and_trials_of_a_chain_have_a_front_too():
    def twice(history, score, **facts):
        return [row(3, score, trial=trial, history=history, cost=0.1, **facts) for trial in range(2)]

    for facts in ({}, {"carry": "notes", "chain": 2}):
        comparisons = compare_windows([*twice(5, 2.0, tokens=100, **facts), *twice(50, 1.0, tokens=200, **facts)])
        assert [c.on_token_front for c in comparisons] == [True, False]
        assert [c.on_cost_front for c in comparisons] == [True, False]


def test_a_flat_row_is_plain_data_with_the_same_columns_everywhere():
    small, full = (as_row(c) for c in compare_windows(cell([30, 41], history=1) + cell([40, 44], history=50)))
    assert list(small) == list(full)
    assert json.loads(json.dumps(small)) == small
    assert (small["history"], small["score"], small["score_difference"], small["pairs"]) == (1, 35.5, -6.5, 2)
    assert (small["score_difference_low"], small["score_difference_high"]) == pytest.approx((-50, 37.97), abs=0.01)
    assert (full["full_context"], full["score_difference"], full["pairs"]) == (True, None, None)
    assert (full["cost"], full["on_cost_front"]) == (None, None)


def test_full_context_is_said_only_where_nothing_left_the_window():
    """A row that does not say so has lost nothing without a cap and with a history of all its steps."""

    def said(**facts):
        comparisons = compare_windows([*cell([1, 2], history=1), *cell([3, 5], **facts)])
        return windows_table(comparisons).rows[2][3]

    assert said(history=50) == said(history=None) == said(history=9, prompt_tokens=700, limited_prompts=0)
    assert said(history=50) == "full context"
    assert said(history=49) == said(history=50, prompt_tokens=700) == said(history=50, limited_prompts=3) == "reference"


def test_strategies_of_files_of_one_name_have_their_paths():
    rows = [r for _ in "ab" for r in cell([1, 2], history=5, prompt_tokens=500)]
    for at, r in enumerate(rows):
        r["budget"] = r["budget"] | {"strategy": f"{'ab'[at // 2]}/s.py:S"}
        r["asked"] = r["asked"] | {"strategy": f"{'ab'[at // 2]}/s.py:S"}
    names = [line[0].strip() for line in windows_table(compare_windows(rows)).rows[1:]]
    assert names == [f"history 5, prompts <= 500, strategy s.py:S, {folder}/s.py:S" for folder in "ab"]
    assert len(set(labels([c.cell for c in compare_windows(rows)]))) == 2


def test_equal_prompts_and_replies_are_identical_and_controls_count_for_nothing():
    groups = [cell([h, h * 2, 7], history=h, player=player) for player in ("rule", "random") for h in (1, 5, 50)]
    rows = [r for group in groups for r in group]
    for r in rows:
        r["play_sha256"] = f"{r['seed']}" if r["budget"]["history"] > 1 else "other"
    comparisons = compare_windows(rows)
    assert comparisons[0].together == compare_windows(rows[:9])[0].together
    table = windows_table(comparisons)
    assert [line[3] for line in table.rows if line[1:]][1::3] == ["identical", "identical"]
    assert any(note.startswith("the intervals of the 2 differences") for note in table.notes)


def test_differences_that_hold_together_are_no_wider_than_by_bonferroni_and_narrower_where_they_correlate():
    generator = np.random.default_rng(0)
    alike = generator.normal(size=20) + 0.1 * generator.normal(size=(8, 20))
    apart = generator.normal(size=(8, 20))

    def level(differences):
        return 1 - jointly([Sample(own.tolist(), None, range(20)) for own in differences]).confidence

    assert 0.05 / 8 <= level(apart) < 0.02 < level(alike) <= 0.05
    assert [level(apart), level(alike)] == pytest.approx([0.006537, 0.03352], rel=1e-3)
    assert level(apart[:1]) == pytest.approx(0.05, rel=0.1)
    assert level(np.ones((4, 20))) == pytest.approx(1 - 0.95**0.25, rel=0.1)  # constant: nothing correlates


def test_cells_with_the_same_window_are_told_apart_by_their_other_caps():
    caps = [{"reply_tokens": 30}, {"reply_tokens": 300}, {"reply_tokens": 300, "tool_calls": 20}]
    comparisons = compare_windows([r for own in caps for r in cell([1, 2], history=5, **own)])
    names = [line[0].strip() for line in windows_table(comparisons).rows[1:]]
    assert names == [
        "history 5, replies <= 30, calls <= 216",
        "history 5, replies <= 300, calls <= 216",
        "history 5, replies <= 300, calls <= 20",
    ]
    assert series_name(comparisons[2], comparisons) == "rule, replies <= 300, calls <= 20"
    assert [(row["reply_tokens"], row["tool_calls"]) for row in map(as_row, comparisons)] == [
        (30, 216), (300, 216), (300, 20)
    ]  # fmt: skip


def test_other_caps_are_not_named_where_windows_tell_cells_apart():
    comparisons = compare_windows(cell([1], history=5, tool_calls=20) + cell([1], history=1, tool_calls=90))
    assert [line[0].strip() for line in windows_table(comparisons).rows if line[1:]] == ["history 5", "history 1"]
    assert {series_name(comparison, comparisons) for comparison in comparisons} == {"rule"}


def test_an_episode_that_the_run_could_not_pay_for_is_not_compared():
    rows = cell([30, 41], history=1) + cell([40, 44], history=50)
    rows[1]["end_reason"] = "run_budget"
    small, full = compare_windows(rows)
    assert (small.episodes, small.differences["score"].mean, small.differences["score"].episodes) == (1, -10, 1)
    assert full.episodes == 2
