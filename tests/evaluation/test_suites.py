"""The suite tools-v1: what it fixes, and that its reference rows are of it."""

from __future__ import annotations

from pathlib import Path

import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.run_folder.folder import RunFolder
from smartplay_tools.evaluation.runs.plan import plan_suite
from smartplay_tools.evaluation.suites import get_suite
from tests.evaluation.command import refused


def test_it_fixes_everything_but_player_and_seed(tmp_path):
    suite = get_suite("tools-v1")
    plan = plan_suite(suite, ["rule"], seed=3)
    assert [(cell.game, cell.budget) for cell in plan.cells] == [(g, b) for g in suite.games for b in suite.budgets]
    assert len(plan.episodes) == 3 * (5 * 10 + 2 * 5)
    with pytest.raises(sp.InvalidArgumentError, match="The suite tools-v1 fixes budgets, trials"):
        sp.evaluate([], ["rule"], out=tmp_path, suite="tools-v1", trials=2, budgets=sp.Budget(history=1))
    words = ["eval", "--suite", "tools-v1", "--prompt-tokens", 900, "--out", tmp_path / "run"]
    assert "fixes budgets" in refused(*words)


@pytest.mark.parametrize("player", ["rule", "random", "first"])
def test_the_reference_rows_are_of_it(player):
    folder = Path(__file__).parents[2] / "experiments" / "tools-v1" / player
    if not folder.exists():
        pytest.skip("not in a checkout")
    plan = plan_suite(get_suite("tools-v1"), [player])
    keys = [episode.key for episode in plan.episodes]
    manifest = RunFolder(folder).manifest()
    assert list(manifest.cells) == list(plan.cells)
    assert [episode.key for episode in manifest.episodes] == keys
    assert [row["key"] for row in RunFolder(folder).rows()] == keys
