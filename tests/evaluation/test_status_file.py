"""The status file: written while a run is played, read by others, gone when the run has stopped."""

from __future__ import annotations

import json
import os
import time
from typing import Any

import pytest
from typer.testing import CliRunner

import smartplay_tools as sp
from smartplay_tools.cli import app
from smartplay_tools.evaluation.run_folder.folder import STATUS, RunFolder
from smartplay_tools.evaluation.run_folder.follower import RunFigures, read_status

HANOI = "Hanoi3Disk-v0"


class Looks:
    """A player that looks at the folder of its own run in its first turn, and then plays on."""

    name = "looks"
    folder: Any = None
    status_and_results: Any = None

    def __init__(self, *, seed: int) -> None:
        self._rule = sp.get_player("rule")

    def reply(self, prompt: sp.Prompt) -> sp.Reply:
        until = time.monotonic() + 30
        while Looks.status_and_results is None and time.monotonic() < until:
            time.sleep(0.005)
            now = read_status(RunFolder(Looks.folder))
            if now is not None and now.running:
                Looks.status_and_results = now, CliRunner().invoke(app, ["results", str(Looks.folder)]).output
        return self._rule.reply(prompt)


def test_it_is_there_while_the_run_is_played(tmp_path, monkeypatch):
    monkeypatch.setattr("smartplay_tools.evaluation.runs.run_progress.PERIOD", 0.02)
    Looks.folder, Looks.status_and_results = tmp_path / "run", None
    sp.evaluate([HANOI], {"looks": Looks}, out=Looks.folder, trials=2, executor="inline")
    now, shown = Looks.status_and_results
    assert (now.planned, now.finished, now.running, now.cost) == (2, 0, 1, 0.0)
    assert "Now: 0/2 episodes, 1 running" in shown
    assert not (Looks.folder / STATUS).exists()


def test_it_may_be_deleted_and_says_nothing_when_it_is_old_or_damaged(tmp_path):
    sp.evaluate([HANOI], ["rule"], out=tmp_path, trials=1, budgets=sp.Budget(tool_calls=1), executor="inline")
    before = sorted(path.name for path in tmp_path.iterdir())
    folder, path = RunFolder(tmp_path), tmp_path / STATUS
    assert read_status(folder) is None
    whole = dict.fromkeys(("finished", "planned", "running", "failed", "calls", "steps", "tokens", "cost"), 1)
    whole |= {"seconds_left": None, "latest_error": "", "stalled": 0}
    path.write_text(json.dumps(whole))
    assert read_status(folder) == RunFigures(**whole)
    for damaged in (
        "",
        "{",
        "[]",
        "null",
        "[" * 100_000,
        json.dumps({**whole, "tokens": "many"}),
        json.dumps({"x": 1}),
    ):
        path.write_text(damaged)
        assert read_status(folder) is None
    path.write_text(json.dumps(whole))
    os.utime(path, (1, 1))
    assert read_status(folder) is None
    sp.evaluate([HANOI], ["rule"], out=tmp_path, trials=1, budgets=sp.Budget(tool_calls=1), executor="inline")
    assert sorted(path.name for path in tmp_path.iterdir()) == before


def test_the_site_reads_it(tmp_path):
    site_runs = pytest.importorskip("smartplay_tools.web.site.site_runs")
    sp.evaluate([HANOI], ["rule"], out=tmp_path, trials=1, budgets=sp.Budget(tool_calls=1), executor="inline")
    run = site_runs.SiteRun(tmp_path, "run")
    assert run.summary()["seconds_left"] is None
    figures = RunFigures(1, 2, 1, 0, 5, 4, 12_345, None, 61.5, "", 0)
    (tmp_path / STATUS).write_text(json.dumps(vars(figures)))
    assert {"tokens": 12_345, "cost": None, "seconds_left": 61.5}.items() <= run.summary().items()
