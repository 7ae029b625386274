"""What stands beside a score: early ends of every kind, steps, points, and bounds that follow the cap on calls."""

from __future__ import annotations

import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.analysis.comparison import as_rows, compare
from smartplay_tools.evaluation.analysis.comparison_tables import comparison_tables
from smartplay_tools.evaluation.analysis.formats import to_latex
from smartplay_tools.evaluation.analysis.headline import headline
from smartplay_tools.evaluation.analysis.summary import summarize
from smartplay_tools.evaluation.analysis.window_tables import points_tables, windows_table
from smartplay_tools.evaluation.analysis.windows import compare_windows
from tests.evaluation.window_rows import row

MARK, HANDS, HANOI = "\N{DOUBLE DAGGER}", "RockPaperScissorBasic-v0", "Hanoi3Disk-v0"


def played(player, steps, end_reason="episode_tokens", game=HANDS, trials=4, scores=None, **facts):
    """Episodes that won a third of their steps, of which as many were lost, so that the game has paid nothing."""
    given = {"player": player, "game": game, "versions": {}, "prompts": "1", "completed": False, "deviations": {}}
    given |= {"illegal_actions": 0, "steps": steps, "end_reason": end_reason, "reward": 0.0} | facts
    return [row(trial, steps // 3 + trial if scores is None else scores, **given) for trial in range(trials)]


def tables(rows):
    """Every table of a run, of a sweep and of a comparison, by its title."""
    comparisons = compare_windows(rows)
    shown = [headline(summarize(rows)), windows_table(comparisons), *points_tables(comparisons)]
    return [*shown, *comparison_tables(compare({"run": rows}))]


ENDS = ["tool_calls", "episode_tokens", "prompt_tokens", "stalled_turns", "no_tool_call", "host", "closed"]


@pytest.mark.parametrize("reason", ENDS)
def test_every_early_end_is_marked_in_every_table_with_steps_beside_the_score(reason):
    narrow = played("rule", 46, reason, prompt_tokens=450)
    rows = [*narrow, *played("rule", 20, reason), *played("random", 20, "rollout")]
    for table in tables(rows):
        marked = [cells[0] for cells in table.rows if MARK in cells[0]]
        assert marked, table.title
        assert all("random" not in name.partition(" against ")[0] for name in marked), table.title
        assert any(f"({reason} 8)" in note for note in table.notes), table.title
        headings = [column.heading for column in table.columns]
        assert "score" not in headings or "steps" in headings, table.title
        assert "\\textdaggerdbl{}" in to_latex(table)


def test_steps_stand_beside_a_score_that_only_grows_and_nothing_where_nothing_differs():
    unequal = tables([*played("rule", 30, "terminated"), *played("random", 50, "rollout")])
    assert [any(c.heading == "steps" for c in table.columns) for table in unequal[:2]] == [True, True]
    final = played("rule", 7, "terminated", HANOI, scores=3.0, reward=3.0)
    final += played("random", 30, "rollout", HANOI, scores=1.0, reward=1.0)
    for table in tables(final):
        assert not {"steps", "points"} & {column.heading for column in table.columns}
        assert MARK not in str(table.rows)


def test_points_are_shown_where_they_are_not_the_score_with_their_difference():
    rows = [*played("rule", 50, "rollout", reward=9.0), *played("random", 50, "rollout")]
    (table,) = [table for table in tables(rows) if table.title.startswith("compared: points")]
    assert [cells[1:] for cells in table.rows[1:]] == [("+9.00", "reference"), ("+0.00", "-9.00 in all 4, p 0.1")]
    (line,) = as_rows(compare({"run": rows}))
    assert (line["reward_difference"], line["steps_difference"], line["ended_early"]) == (-9, 0, 0)


@pytest.mark.parametrize(("calls", "most"), [(20, 20), (7, 7), (216, 50)])
def test_no_interval_ends_where_so_many_calls_cannot_lead(calls, most):
    capped = played("rule", 5, "tool_calls", tool_calls=calls, scores=0.0)
    spread = [row(at, score, game=HANDS, tool_calls=calls, reward=reward) for at, (score, reward) in enumerate(
        [(0, -most), (most, most), (0, -most), (most, most)]
    )]  # fmt: skip
    for rows, equal in ((capped, True), (spread, False)):
        (cell,) = compare_windows(rows)
        assert (cell.means["score"].low, cell.means["score"].high <= most) == (0, True)
        assert equal or (cell.means["score"].high, cell.means["reward"].high) == (most, most)
    share = 1 - 0.05 ** (1 / 4)
    assert compare_windows(capped)[0].means["score"].high == pytest.approx(share * most)


def test_a_shorter_rollout_bounds_scores_and_points_as_well():
    spec = sp.GAMES["RockPaperScissorDifferentScore-v0"]
    assert (spec.bounds_in(1_000), spec.points_in(1_000)) == ((0, 50), (-100, 100))
    assert (spec.bounds_in(20), spec.points_in(20)) == ((0, 20), (-40, 40))
    assert sp.GAMES[HANOI].bounds_in(3) == (0, 3)


def test_equal_pairs_are_said_to_be_equal():
    rows = [*played("rule", 50, "rollout", scores=9.0), *played("rule", 50, "rollout", scores=9.0, prompt_tokens=900)]
    assert "equal in all 4" in windows_table(compare_windows(rows)).rows[2]


def test_one_sweep_has_one_reference_in_both_of_its_tables():
    wide, narrow = played("rule", 50, "rollout"), played("rule", 50, "rollout", prompt_tokens=450, scores=0.0)
    others = played("random", 50, "rollout", prompt_tokens=450), played("random", 50, "rollout")
    rows = [*narrow, *wide, *others[0], *others[1]]
    (swept,) = [c for c in compare_windows(rows) if c.cell.player == "rule" and not c.is_reference]
    first, *rest = compare({"sweep": rows}).pairings
    assert first.differences["score"].mean == swept.differences["score"].mean < 0
    assert [(p.side.label == p.reference.label, p.side.player, p.reference.player) for p in rest] == [
        (False, "random", "random"), (True, "random", "rule"),
    ]  # fmt: skip
