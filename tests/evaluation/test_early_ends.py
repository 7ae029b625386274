"""An early end is no success: how means and tables count episodes that a budget, a stall or a strategy ended."""

from __future__ import annotations

import dataclasses
from typing import get_args

import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.analysis.headline import TERMS, headline
from smartplay_tools.evaluation.analysis.summary import summarize
from smartplay_tools.evaluation.analysis.window_tables import windows_table
from smartplay_tools.evaluation.analysis.windows import compare_windows
from smartplay_tools.games.specs import GAMES
from smartplay_tools.records import Record, replay
from smartplay_tools.records.rows import mean_score, recorded_score
from smartplay_tools.types import EndReason
from smartplay_tools.web.site import site_runs
from smartplay_tools.web.site.listed import COLUMNS
from tests.evaluation.window_rows import row

BANDIT, MESSENGER, HANOI = "BanditTwoArmedHighLowFixed-v0", "MessengerL1-v0", "Hanoi3Disk-v0"


@pytest.fixture
def cards():
    """A game of 50 cards, each of which gains or loses 0.02 of a point."""
    spec = dataclasses.replace(GAMES[BANDIT], id="Cards-v0", score_bounds=(-1, 1), worst_step=-0.02)
    return sp.register(spec).id


def early(game, score=0.0, steps=1, end_reason="prompt_tokens", **facts):
    return row(score=score, game=game, steps=steps, end_reason=end_reason, **facts)


@pytest.mark.parametrize("reason", get_args(EndReason))
def test_only_the_ends_that_budgets_stalls_strategies_and_wrong_values_cause_count(cards, reason):
    counts = {"prompt_tokens", "episode_tokens", "tool_calls", "stalled_turns", "no_tool_call"}
    counts |= {"strategy_error", "game_error", "episode_cost"}
    assert (mean_score(early(cards, end_reason=reason)) < 0) == (reason in counts)


@pytest.mark.parametrize(("game", "score"), [(BANDIT, 12.0), (MESSENGER, 0.0), (HANOI, 1.0), ("Crafter-v0", 9.0)])
def test_the_paper_s_settings_keep_the_paper_s_score(game, score):
    assert mean_score(early(game, score)) == score


def test_a_game_that_is_not_known_here_counts_with_its_score():
    assert mean_score(early("Unheard-v0", 0.5)) == 0.5


def test_a_table_keeps_every_episode_and_marks_the_cell(cards):
    rows = [row(0, 0.5, game=cards), early(cards, seed=1)]
    rows = [complete(each) for each in rows]
    summary = summarize(rows)
    (cell,) = summary.cells
    assert (cell.episodes, cell.early) == (2, 1)
    assert cell.score.mean == pytest.approx((0.5 - 0.98) / 2)
    table = headline(summary)
    assert "rule\N{DOUBLE DAGGER}" in table.rows[1][0]
    assert any("ended before their game did (prompt_tokens 1)" in note for note in table.notes)
    assert "\N{DOUBLE DAGGER}" in TERMS
    windows = windows_table(compare_windows(rows))
    assert windows.rows[1][0].endswith("\N{DOUBLE DAGGER}")
    assert rows[1]["score"] == 0


def test_every_reader_of_a_run_counts_so_where_the_game_is_not_known(cards, tmp_path, monkeypatch):
    """The record says what scores can be, so that the process that reads it need not know the game."""
    run = sp.evaluate([cards], ["random"], trials=4, budgets=[sp.Budget(tool_calls=1)], executor="inline", out=tmp_path)
    paths = [run.transcript(row["key"]) for row in run.rows]
    counted = [max(-1, row["score"] - 49 * 0.02) for row in run.rows]
    with monkeypatch.context() as elsewhere:
        elsewhere.setattr(GAMES, "_specs", {})
        assert summarize(run.folder.rows()).cells[0].score.mean == pytest.approx(sum(counted) / 4)
        assert [recorded_score(Record.head(path)) for path in paths] == pytest.approx(counted)
        site = [dict(zip(COLUMNS, one, strict=True)) for one in site_runs.SiteRun(tmp_path, "").episodes()]
        assert [one["counted"] for one in site] == pytest.approx(counted)
    older = [dict(event) for event in Record.read(paths[0]).events]
    del older[0]["scoring"]
    assert all("chain is broken" in difference for difference in replay(older).differences)


def complete(short):
    """A row with the fields that a summary reads."""
    counts = dict.fromkeys(("turns", "illegal_actions", "malformed_calls", "refused_calls", "idle_replies"), 0)
    facts = {"fallback_actions": 0, "deviations": {}, "completed": False, "reward": short["score"], "prompts": "1"}
    return {**counts, **facts, **short, "normalized_score": None}
