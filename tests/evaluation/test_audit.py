"""`smartplay-tools replay RUN_DIR`: every record of a run is replayed and compared with its row."""

from __future__ import annotations

import dataclasses
import importlib
import json
import shutil
from pathlib import Path

import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.runs.audit import audit as audited
from smartplay_tools.evaluation.runs.runner import Run
from tests.evaluation.command import result_of
from tests.evaluation.report_runs import known_for_now

GAMES = ["BanditTwoArmedHighLowFixed-v0", "Hanoi3Disk-v0"]


ASKED = {"games": GAMES, "players": ["rule"], "trials": 2, "executor": "inline"}


@pytest.fixture(scope="module")
def played(tmp_path_factory):
    """The folder of a run, which no test changes."""
    folder = tmp_path_factory.mktemp("played")
    sp.evaluate(out=folder, **ASKED)
    return folder


@pytest.fixture
def run(played, tmp_path):
    """A copy of the run, which is complete, so nothing is played."""
    shutil.copytree(played, tmp_path, dirs_exist_ok=True)
    return sp.evaluate(out=tmp_path, **ASKED)


def audit(run: Run, *arguments: str) -> tuple[int, str]:
    done = result_of("replay", run.folder.path, "--workers", 1, *arguments)
    return done.exit_code, done.output


def change(path, before: str, after: str) -> None:
    text = path.read_text()
    assert before in text
    path.write_text(text.replace(before, after, 1))


def test_a_run_that_is_what_it_says_is_identical(run):
    assert audit(run) == (0, f"identical: all 4 episodes of {run.folder.path}\n")


def record(run: Run) -> Path:
    return run.folder.transcript(run.rows[2]["key"])


def break_off(path: Path) -> None:
    path.write_text("".join(path.read_text().splitlines(keepends=True)[:-1]))


@pytest.mark.parametrize(
    ("spoil", "sentence"),
    [
        (lambda run: change(record(run), '"is_error": false', '"is_error": true'), "is_error is False in the replay"),
        (
            lambda run: change(run.folder.path / "results.jsonl", '"completed": true', '"completed": false'),
            "The field completed is False in the row, True in the record.",
        ),
        (lambda run: break_off(record(run)), "The record is incomplete"),
        (lambda run: record(run).unlink(), "There is no file"),
    ],
    ids=["an answer", "a row", "a record that breaks off", "a record that is not there"],
)
def test_what_is_not_as_it_was_played_is_found(run, spoil, sentence):
    spoil(run)
    code, output = audit(run)
    assert code == 1
    assert "1 of 4 episodes differ" in output
    assert sentence in output
    assert run.rows[2]["key"] in output


def test_records_that_have_changed_places_are_found(run):
    one, two = (run.folder.transcript(row["key"]) for row in run.rows[:2])
    text = one.read_text()
    one.write_text(two.read_text())
    two.write_text(text)
    code, output = audit(run, "--json")
    assert code == 1
    findings = json.loads(output)
    assert sum(bool(finding["differences"]) for finding in findings) == 2
    assert any("The record is of another episode" in text for finding in findings for text in finding["differences"])


def test_a_planned_episode_without_a_row_is_missing(run):
    """Rows that are lost, a plan of which nothing was played, and a record that nobody planned."""
    folder, rows = run.folder.path, run.folder.path / "results.jsonl"
    lines = rows.read_text().splitlines(keepends=True)
    rows.write_text("".join(lines[:1]))
    code, output = audit(run)
    assert code == 1
    assert "1 of 4 planned episodes are identical; 3 have no row" in output
    assert output.count("It has a record and no row; the run's own command makes it") == 3
    assert [len(finding["differences"]) for finding in json.loads(audit(run, "--json")[1])].count(1) == 3
    rows.unlink()
    shutil.rmtree(folder / "episodes")
    assert audit(run) == (1, "0 of 4 planned episodes are identical; 4 have no row\n")
    (folder / "episodes").mkdir()
    (folder / "episodes" / f"{'0' * 16}.jsonl").write_text("")
    assert "It has a record and is not in the plan." in audit(run)[1]


@pytest.fixture
def _every_record_is_worth_a_process(monkeypatch):
    monkeypatch.setattr(importlib.import_module("smartplay_tools.evaluation.runs.audit"), "WORTH_A_PROCESS", 1)


@pytest.mark.usefixtures("_every_record_is_worth_a_process")
def test_a_game_that_only_this_process_knows_is_replayed_by_it_alone(tmp_path, monkeypatch):
    known_for_now(monkeypatch, dataclasses.replace(sp.GAMES["Hanoi3Disk-v0"], id="MyHanoi-v0"))
    own = sp.evaluate(["MyHanoi-v0"], ["rule"], out=tmp_path / "own", trials=3, executor="inline")
    assert [finding.differences for finding in audited(own.folder, 3)] == [()] * 3


@pytest.mark.usefixtures("_every_record_is_worth_a_process")
def test_a_record_that_cannot_be_opened_is_a_finding(run):
    record = run.folder.transcript(run.rows[0]["key"])
    record.unlink()
    record.symlink_to(record)
    (damaged,) = [finding for finding in audited(run.folder, 1) if finding.differences]
    assert damaged.key == run.rows[0]["key"]
    assert "cannot be read" in damaged.differences[0]
