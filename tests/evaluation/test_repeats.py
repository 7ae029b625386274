"""Worlds that are played again: what is the player's own spread, and how often it succeeds."""

from __future__ import annotations

import json

import numpy as np
import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.analysis import pairs
from smartplay_tools.evaluation.analysis.repeats import (
    as_json,
    icc,
    noise_floor,
    pass_all,
    pass_at,
    repeated,
    repeats_table,
    variances,
)
from smartplay_tools.evaluation.analysis.summary import summarize
from smartplay_tools.evaluation.pages.report.page import write_report
from tests.evaluation.command import shown_by

GAME = "MessengerL1-v0"


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    out = tmp_path_factory.mktemp("repeats") / "run"
    return sp.evaluate([GAME], ["random", "rule"], trials=6, repeats=3, executor="inline", out=out)


def test_each_world_is_played_again_with_other_numbers_of_the_player(run):
    assert len(run.rows) == 2 * 6 * 3
    random = [row for row in run.rows if row["player"] == "random"]
    assert [row["seed"] for row in random] == sorted(row["seed"] for row in random)
    assert len({row["seed"] for row in random}) == 6
    assert len({row["key"] for row in random}) == 18
    hashes = [{row["state_hash"] for row in random if row["seed"] == seed} for seed in {r["seed"] for r in random}]
    assert any(len(states) > 1 for states in hashes)


@pytest.mark.slow
def test_the_same_worlds_played_once_have_the_keys_that_they_always_had(run, tmp_path):
    once = sp.evaluate([GAME], ["random"], trials=6, executor="inline", out=tmp_path / "once")
    first = [row for row in run.rows if row["player"] == "random" and row["trial"] % 3 == 0]
    assert [row["key"] for row in once.rows] == [row["key"] for row in first]


def test_worlds_are_the_sample_of_a_mean(run):
    (random, _) = summarize(run.rows).cells
    assert (random.episodes, random.score.episodes) == (18, 6)
    assert random.score.mean == pytest.approx(np.mean([r["score"] for r in run.rows if r["player"] == "random"]))
    rows = {name: [row for row in run.rows if row["player"] == name] for name in ("random", "rule")}
    assert pairs.paired_difference(rows["rule"], rows["random"], pairs.score).episodes == 6


def test_worlds_are_the_sample_of_a_capability_score_too(run):
    random, rule = summarize(run.rows).profiles
    worlds = [row for row in run.rows if row["player"] == "rule"][::3]
    (once,) = summarize(worlds).profiles
    assert rule.capabilities == once.capabilities
    estimate = random.capabilities.scores[0].estimate
    assert estimate is not None
    assert estimate.episodes == 6


def test_a_player_that_plays_a_world_always_alike(run):
    random, rule = repeated(run.rows)
    assert (rule.within, rule.noise_floor) == (0, 0)
    assert random.within > 0
    assert random.noise_floor > 0


def test_figures_of_a_worked_example():
    scores = np.array([[1.0, 1.0, 0.0, 1.0], [0.0, 0.0, 0.0, 1.0], [1.0, 1.0, 1.0, 1.0]])
    within, between = variances(scores)
    assert within == pytest.approx((0.25 + 0.25 + 0) / 3)
    assert between == pytest.approx(np.var([0.75, 0.25, 1], ddof=1) - within / 4)
    assert icc(scores) == pytest.approx(between / (between + within))
    assert [pass_at(3, 4, 1), pass_at(3, 4, 2), pass_all(3, 4, 1), pass_all(3, 4, 2)] == [0.75, 1, 0.75, 0.5]


def test_the_commands(run, tmp_path):
    shown = shown_by("results", run.folder.path)
    assert "pass^k" in shown
    assert "6 x 3" in shown
    page = write_report(run.folder.path, tmp_path / "page.html").read_text(encoding="utf-8")
    assert "pass^k" in page
    printed = json.loads(shown_by("results", run.folder.path, "--json"))["repeats"]
    assert [each["repeats"] for each in printed] == [3, 3]
    assert len(printed[1]["pass^3"]) == 3
    with pytest.raises(sp.InvalidArgumentError, match="plays each world 3 times"):
        sp.evaluate([GAME], ["random", "rule"], trials=6, executor="inline", out=run.folder.path)


def test_a_world_that_was_not_repeated_takes_no_others_with_it(run):
    rows = [row for row in run.rows if row["player"] == "random"]
    (whole,), (begun,) = repeated(rows), repeated(rows[:-2])
    assert (whole.worlds, whole.repeats, whole.left_out) == (6, 3, 0)
    assert (begun.worlds, begun.repeats, begun.left_out) == (5, 3, 1)
    assert "1 episodes are left out" in repeats_table([begun]).notes[-1]


def test_budgets_of_one_player_are_told_apart(tmp_path):
    budgets = [sp.Budget(history=0), sp.Budget(history=1)]
    run = sp.evaluate([GAME], ["rule"], budgets=budgets, trials=2, repeats=2, executor="inline", out=tmp_path)
    figures = repeated(run.rows)
    assert [row[0].strip() for row in repeats_table(figures).rows] == [GAME, "rule, history 0", "rule, history 1"]
    assert [as_json(each)["condition"] for each in figures] == ["history 0", "history 1"]


@pytest.mark.slow
def test_the_noise_floor_is_what_a_player_has_with_itself():
    """Differences of two runs of one player on the same 30 worlds are below the floor in 95 of 100."""
    generator, below = np.random.default_rng(4), []
    for _ in range(2_000):
        chances = generator.beta(2, 2, size=30)[:, None]
        one, other = ((generator.random((30, 5)) < chances).astype(float) for _ in range(2))
        below.append(abs(one.mean() - other.mean()) <= noise_floor(variances(one)[0], 30, 5))
    assert 0.93 <= np.mean(below) <= 0.97
