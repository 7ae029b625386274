"""A run that stops when it is decided: its words, its errors at any look, and what it plays."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

import smartplay_tools as sp
from smartplay_tools.cli import app
from smartplay_tools.evaluation.analysis import pairs
from smartplay_tools.evaluation.analysis.intervals import Bounds
from smartplay_tools.evaluation.analysis.stopping import judge
from smartplay_tools.records.manifest import Until
from tests.evaluation.populations import BANDIT, HANOI, MESSENGER, RPS, tilted

UNIT = Bounds(-1, 1)


def test_the_words():
    assert judge([1.0] * 40, UNIT, 0.1).word == "different"
    assert judge([0.0] * 100, UNIT, 0.2).word == "equivalent"
    assert judge([1.0, -1.0] * 10, UNIT, 0.1).word == "undecided"


def test_what_comes_after_the_decision_changes_nothing():
    decided = judge([1.0] * 40, UNIT, 0.1)
    assert decided.pairs < 12
    assert judge([1.0] * decided.pairs + [-1.0] * 40, UNIT, 0.1) == decided


def test_more_comparisons_take_more_pairs():
    assert judge([1.0] * 40, UNIT, 0.1).pairs < judge([1.0] * 40, UNIT, 0.1, comparisons=20).pairs


def test_the_interval_holds_the_mean_and_becomes_narrower():
    few, many = judge([0.5, -0.5] * 5, UNIT, 0.01), judge([0.5, -0.5] * 100, UNIT, 0.01)
    assert few.low < many.low < 0 < many.high < few.high


@pytest.fixture(scope="module")
def stopped(tmp_path_factory):
    out = tmp_path_factory.mktemp("stopped") / "run"
    options = {"trials": 30, "executor": "inline", "until": Until("1")}
    return out, options, sp.evaluate([BANDIT], ["rule", "random"], out=out, **options)


def test_a_run_stops_when_it_is_decided(stopped):
    _, _, run = stopped
    (decision,) = run.decisions
    assert decision.stop.word == "different"
    assert len(run.rows) == 2 * decision.stop.pairs < 30
    assert run.complete
    assert run.spared == 60 - len(run.rows)
    assert {row["trial"] for row in run.rows} == set(range(decision.stop.pairs))  # trial by trial across cells


def test_the_same_call_plays_no_more(stopped):
    out, options, run = stopped
    again = sp.evaluate([BANDIT], ["rule", "random"], out=out, **options)
    assert (again.rows, again.decisions) == (run.rows, run.decisions)
    for until in (None, Until("2")):
        with pytest.raises(sp.InvalidArgumentError, match="declared before its first pair"):
            sp.evaluate([BANDIT], ["rule", "random"], out=out, **{**options, "until": until})


def test_results_show_the_word(stopped):
    out, _, _ = stopped
    shown = CliRunner(env={"COLUMNS": "80"}).invoke(app, ["results", str(out)]).output
    assert "until decided" in shown
    assert "different" in shown


def test_the_command(tmp_path):
    given = ["eval", "--games", BANDIT, "--players", "rule,random", "--trials", "20", "--out", str(tmp_path / "run")]
    given += ["--executor", "inline", "--until", "decided", "--quiet"]
    runner = CliRunner()
    assert "--margin M" in runner.invoke(app, given).output
    assert runner.invoke(app, [*given, "--margin", "0.1h"]).exit_code == 0
    manifest = json.loads((tmp_path / "run" / "manifest.json").read_text(encoding="utf-8"))
    assert manifest["until"] == {"margin": "0.1h", "clip": None, "by": "score"}


def test_a_game_without_bounds_or_one_player_is_refused_before_anything_is_played(tmp_path):
    with pytest.raises(sp.InvalidArgumentError, match="name two players"):
        sp.evaluate([BANDIT], ["rule"], out=tmp_path / "alone", until=Until("1"))


# Simulations.

REPETITIONS = 2_000


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cell", "margin", "clip", "most_used"),
    [
        ((HANOI, "random", 50), 0.5, None, 0.40),
        ((MESSENGER, "random", 3), 0.4, None, 0.40),
        ((BANDIT, "random", 50), 3, None, 0.50),
        ((RPS, "random", 50), 5, None, 0.40),
    ],
)
@pytest.mark.parametrize("planned", [20, 50, 100])
def test_errors_at_any_look_and_what_is_saved(played, cell, margin, clip, most_used, planned):
    """A word is wrong in at most 5 %; a difference of twice the margin takes less than half of 100 planned pairs."""
    sample = pairs.sample(played[cell], pairs.score)
    scores = np.array(sample.values)
    differences = np.random.default_rng(1).permutation(scores) - scores
    bounds = sample.bounds.of_differences

    def stops(truth):
        generator = np.random.default_rng(2)
        drawn = generator.choice(differences, size=(REPETITIONS, planned), p=tilted(differences, truth))
        return [judge(values, bounds, margin) for values in drawn]

    assert np.mean([stop.word == "different" for stop in stops(0)]) <= 0.05
    assert np.mean([stop.word == "equivalent" for stop in stops(margin)]) <= 0.05
    apart = stops(2 * margin)
    assert np.mean([stop.low <= 2 * margin <= stop.high for stop in apart]) >= 0.95
    if planned == 100:
        assert np.mean([stop.pairs for stop in apart]) <= most_used * planned


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.02, 0.5, 0.98])
def test_errors_with_rare_failures(share):
    """Each side fails with this probability: the words are wrong no more often than in other cases."""
    generator = np.random.default_rng(3)
    sides = (generator.random((2, REPETITIONS, 100)) < share).astype(float)
    assert np.mean([judge(values, UNIT, 0.2).word == "different" for values in sides[0] - sides[1]]) <= 0.05
    shifted = np.where(generator.random((REPETITIONS, 100)) < 0.2, 1.0, 0.0)
    assert np.mean([judge(values, UNIT, 0.2).word == "equivalent" for values in shifted]) <= 0.05
