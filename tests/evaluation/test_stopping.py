"""A run that stops when it is decided: its words, its errors at any look, and what it plays."""

from __future__ import annotations

import json

import numpy as np
import pytest
import scipy
from typer.testing import CliRunner

import smartplay_tools as sp
from smartplay_tools.cli import app
from smartplay_tools.evaluation.analysis.stopping import decided_at, judge
from smartplay_tools.evaluation.run_folder.folder import Until
from smartplay_tools.statistics.intervals import Bounds
from tests.evaluation import simulations
from tests.evaluation.populations import BANDIT, HANOI, RPS, tilted
from tests.evaluation.simulated_tables import agrees, published

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


@pytest.mark.slow
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


def test_scores_without_bounds_are_clipped_to_twice_the_human_score(tmp_path):
    """One pair says nearly nothing: the interval is all that a difference can be."""
    short = {"budgets": sp.Budget(tool_calls=2), "trials": 1, "executor": "inline", "out": tmp_path / "run"}
    (decision,) = sp.evaluate(["Crafter-v0"], ["first", "random"], until=Until("0.1h"), **short).decisions
    assert (decision.stop.low, decision.stop.high, decision.margin) == (-2 * 2680, 2 * 2680, 268)


# Simulations.


@pytest.mark.slow
def test_the_page_says_how_often_stopping_errs_and_what_it_saves():
    figures = simulations.stopping()
    assert figures.keys() == published("stopping").keys()
    assert all(agrees("stopping", name, own) for name, own in figures.items())
    assert max(error for different, equivalent, *_ in figures.values() for error in (different, equivalent)) <= 0.05


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.02, 0.5, 0.98])
def test_errors_with_rare_failures(share):
    """Each side fails with this probability: the words are wrong no more often than in other cases."""
    generator = np.random.default_rng(3)
    sides = (generator.random((2, simulations.REPETITIONS, 100)) < share).astype(float)
    assert simulations.stops(sides[0] - sides[1], UNIT, 0.2).different <= 0.05
    shifted = np.where(generator.random((simulations.REPETITIONS, 100)) < 0.2, 1.0, 0.0)
    assert simulations.stops(shifted, UNIT, 0.2).equivalent <= 0.05


@pytest.mark.slow
def test_several_comparisons_share_the_errors():
    """Five players that score as the first one does: any of them is "different" in at most 5 % of runs."""
    scores = np.random.default_rng(4).choice([-1.0, 0.0, 1.0], size=(6, simulations.REPETITIONS, 100))
    places = [decided_at(each - scores[0], Bounds(-2, 2), 0.4, 5) for each in scores[1:]]
    wrong = np.any([(different < 100) & (different <= equivalent) for different, equivalent in places], axis=0)
    assert np.mean(wrong) <= 0.05


@pytest.mark.slow
def test_looking_at_an_ordinary_interval_after_every_pair_errs_more_often():
    """Student's t of players that score alike, from the fifth of 100 pairs on: 0 is outside at some look in a fifth."""
    population = simulations.against_itself((RPS, "random", 50))
    drawn = simulations.draw(population, 100, 6, tilted(population.values, 0))
    n = np.arange(1, 101)
    mean = np.cumsum(drawn, axis=1) / n
    variance = (np.cumsum(drawn**2, axis=1) - n * mean**2)[:, 4:] / (n[4:] - 1)
    half = scipy.stats.t.ppf(0.975, n[4:] - 1) * np.sqrt(variance / n[4:])
    assert np.mean(np.any(np.abs(mean[:, 4:]) > half, axis=1)) >= 0.2


@pytest.mark.slow
@pytest.mark.parametrize("truth", [0.0, 1.0])
def test_the_interval_at_the_end_holds_the_truth(truth):
    """The confidence sequence, whenever the run stopped: 400 runs, since its means are searched one by one."""
    population = simulations.against_itself((HANOI, "random", 50))
    drawn = simulations.draw(population, 100, 5, tilted(population.values, truth))[:400]
    ends = [(stop.low, stop.high) for stop in (judge(values, population.bounds, 0.5) for values in drawn.tolist())]
    assert np.mean([low <= truth <= high for low, high in ends]) >= 0.95
