"""The progress display of a run: on a terminal, in a log, and in another terminal."""

from __future__ import annotations

import io
import os
import re
import time
from dataclasses import replace
from functools import partial

import pytest
from rich.console import Console

import smartplay_tools as sp
from smartplay_tools.cli.progress import showing
from smartplay_tools.evaluation.run_folder.folder import RunFolder
from smartplay_tools.evaluation.run_folder.follower import RunFollower, run_snapshot
from smartplay_tools.evaluation.runs.plan import make_cells, plan_episodes
from smartplay_tools.evaluation.runs.run_options import RunOptions
from smartplay_tools.evaluation.runs.runner import run_plan
from tests.evaluation.command import shown_by
from tests.evaluation.runs import under_way

BANDIT, HANOI = "BanditTwoArmedHighLowFixed-v0", "Hanoi3Disk-v0"


def half_played(tmp_path) -> RunFolder:
    """A run's folder as it stands while its second episode is being played."""
    run = sp.evaluate([BANDIT], ["random"], out=tmp_path, trials=2, executor="inline")
    under_way(tmp_path, run.rows[1]["key"])
    return run.folder


def test_an_episode_under_way_is_read_from_its_growing_record(tmp_path):
    folder = half_played(tmp_path)
    follower = RunFollower(folder)
    (record,) = follower.snapshot().playing
    assert (record.game, record.player) == (BANDIT, "random")
    assert 20 <= record.steps <= 30
    before = record.totals.replies
    assert before in (record.steps, record.steps + 1)
    assert record.totals.tokens > 0
    written = record.path.read_text()
    usage = '{"event": "usage", "turn": 99, "prompt": 7, "reply": 1, "provider": null}\n'
    record.path.write_text(written[: written.rindex("\n") + 1] + usage)
    assert follower.snapshot().playing == (record,)
    assert record.totals.replies == before + 1
    assert run_snapshot(folder).running == 1


@pytest.mark.parametrize(("seconds", "is_live"), [(0, True), (400, True), (700, False)])
def test_a_run_is_being_played_while_a_record_grows(tmp_path, seconds, is_live):
    """A model may think for as long as a client waits; a run that was killed has been silent for longer."""
    folder = half_played(tmp_path)
    (record,) = folder.running()
    os.utime(record, times=(time.time() - seconds,) * 2)
    assert run_snapshot(folder).is_live is is_live
    assert ("Now: 1/2 episodes, 1 running" in shown_by("results", tmp_path, columns=200)) is is_live


def test_a_log_has_lines_with_times_and_a_failure_is_logged_beside_it(tmp_path, caplog):
    plan = plan_episodes(make_cells([HANOI], ["rule", "broken"], [sp.Budget()]), trials=1)
    from tests.evaluation.players import Broken

    console = Console(file=io.StringIO(), width=80)
    options = RunOptions(executor="inline", run_tokens=10_000_000)
    display = partial(showing, console)
    run_plan(plan, tmp_path, {"broken": Broken}, options, display=display)
    lines = console.file.getvalue().splitlines()
    assert all(re.match(r"\d\d:\d\d:\d\d ", line) for line in lines)
    [said] = [message for message in caplog.messages if "failed: RuntimeError: no more ideas" in message]
    assert said.startswith(f"broken at {HANOI} (")
    assert "1/2 episodes" in lines[-1]
    assert "/10.0M tokens" in lines[0]


def test_a_terminal_shows_the_figures_until_the_run_is_over(tmp_path):
    snapshot = run_snapshot(half_played(tmp_path))
    snapshot = replace(snapshot, failed=1, caps={"cost": 5.0})
    console = Console(width=80, height=24, file=io.StringIO(), force_terminal=True)
    with showing(console) as show:
        show(snapshot)
    text = " ".join(re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", console.file.getvalue()).split())
    for word in ("1/2 episodes", "1 running", "calls", "tokens", "/5.00", "1 failed"):
        assert word in text
    assert text.isascii()
