"""What pipelines ask of a run: means, a stored run, exit codes and JUnit XML."""

from __future__ import annotations

from xml.etree import ElementTree

import pytest
from typer.testing import CliRunner

import smartplay_tools as sp
from smartplay_tools.cli import app
from smartplay_tools.evaluation.analysis.gates import mean_gates
from smartplay_tools.evaluation.analysis.pairs import RowCondition
from tests.evaluation.runs import play_rows

GAME = "Hanoi3Disk-v0"


@pytest.fixture
def run(tmp_path):
    def invoke(name, *options, player="rule"):
        given = ["eval", "--games", GAME, "--players", player, "--trials", "10", "--executor", "inline", "--quiet"]
        return CliRunner().invoke(app, [*given, "--out", str(tmp_path / name), *options])

    return invoke


def test_a_mean_that_is_too_low_fails_the_command(run, tmp_path):
    file = tmp_path / "junit.xml"
    assert run("a", "--fail-if", "score < 3", "--junit", str(file)).exit_code == 0
    assert ElementTree.parse(file).getroot()[0].attrib["failures"] == "0"
    shown = run("a", "--fail-if", "score <= 3", "--fail-if", "tokens > 1", "--junit", str(file))
    assert shown.exit_code == 1
    assert "score is 3 (mean of 10)" in shown.output
    (suite,) = ElementTree.parse(file).getroot()
    assert (suite.attrib["tests"], suite.attrib["failures"]) == ("2", "2")
    assert suite[0].attrib == {"classname": GAME, "name": "rule, score <= 3"}


def test_a_run_that_is_worse_than_the_one_before_fails(run, tmp_path):
    run("good")
    assert run("again", "--baseline", str(tmp_path / "good"), "--margin", "1").exit_code == 0
    shown = run("bad", "--baseline", str(tmp_path / "good"), "--margin", "1", player="random")
    assert shown.exit_code == 1
    assert "different within 1" in shown.output


def test_budgets_of_one_player_are_told_apart():
    rows = [row for history in (1, 5) for row in play_rows(GAME, trials=1, budget=sp.Budget(history=history))]
    names = [gate.name for gate in mean_gates(rows, [RowCondition.parse("score < 3")])]
    assert names == ["rule, history 1, score < 3", "rule, history 5, score < 3"]


def test_what_is_asked_wrongly_is_one_sentence(run, tmp_path):
    assert "--baseline needs --margin" in run("x", "--baseline", str(tmp_path)).output
    assert "is not a condition" in run("x", "--fail-if", "bad").output
    unwritten = run("x", "--junit", str(tmp_path))
    assert (unwritten.exit_code, f"{tmp_path} cannot be read or written" in unwritten.output) == (2, True)
