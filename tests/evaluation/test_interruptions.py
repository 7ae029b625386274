"""A run that is killed or stopped at any moment and run again has the same files as an uninterrupted one."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from smartplay_tools.evaluation.run_folder.folder import RunFolder
from smartplay_tools.evaluation.runs.audit import audit
from tests.processes import heed_interrupts, is_running, is_soon, needs_proc, needs_unix

pytestmark = pytest.mark.slow

BANDIT, HANOI = "BanditTwoArmedHighLowFixed-v0", "Hanoi3Disk-v0"
ROOT = Path(__file__).parents[2]

SCRIPT = """
import sys
import smartplay_tools as sp
from tests.evaluation.players import Slow

if __name__ == "__main__":
    out, executor, seconds = sys.argv[1], sys.argv[2], float(sys.argv[3])
    run = sp.evaluate({games!r}, out=out, trials={trials}, executor=executor, workers=2,
                      on_progress=lambda p: print(p.finished, flush=True), {options})
    print("stopped by", run.stopped, flush=True)
    sys.exit(0 if run.complete else 1)
"""


SLOW = 'players={"slow": Slow}, player_options={"seconds": seconds}'
CHAINS = 'players=["rule-notes"], carry="notes", chain=3, budgets=sp.Budget(notes_tokens=100)'


def start(
    out: Path, executor: str, *, games: list[str], trials: int, seconds: float, options: str = SLOW
) -> subprocess.Popen[str]:
    """A run in a separate process."""
    needs_unix()
    script = out.parent / "script.py"
    script.write_text(SCRIPT.format(games=games, trials=trials, options=options))
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}
    command = [sys.executable, str(script), str(out), executor, str(seconds)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment, preexec_fn=heed_interrupts)


def children(pid: int) -> list[int]:
    files = Path(f"/proc/{pid}/task").glob("*/children")
    return [int(number) for file in files for number in file.read_text().split()]


@pytest.mark.parametrize(("options", "kills"), [(SLOW, 2), (CHAINS, 1)])
def test_a_run_that_was_killed_has_the_rows_of_one_that_was_not(tmp_path, options, kills):
    how = {"games": [BANDIT, HANOI], "trials": 6, "seconds": 0.001, "options": options}
    with start(tmp_path / "whole", "inline", **how) as process:
        assert process.wait(120) == 0
    for executor in ("inline", "processes"):
        chance, killed = random.Random(f"kills {executor}"), tmp_path / executor
        for _ in range(kills):
            with start(killed, executor, **how) as process:
                assert process.stdout is not None
                process.stdout.readline()  # the run has begun
                time.sleep(chance.random() * 0.8)
                process.kill()
        with start(killed, executor, **how) as process:
            assert process.wait(120) == 0
        assert (killed / "results.jsonl").read_bytes() == (tmp_path / "whole" / "results.jsonl").read_bytes()
        assert {failure["end_reason"] for failure in RunFolder(killed).failures()} <= {"interrupted"}
        assert list((killed / "running").iterdir()) == []
        assert not any(finding.differences for finding in audit(RunFolder(killed), 1))


@pytest.mark.parametrize(
    ("executor", "number"), [("inline", signal.SIGINT), ("processes", signal.SIGTERM), ("async", signal.SIGTERM)]
)
def test_a_signal_stops_a_run_between_two_turns(tmp_path, executor, number):
    with start(tmp_path / "run", executor, games=[BANDIT], trials=40, seconds=0.05) as process:
        assert process.stdout is not None
        process.stdout.readline()
        process.stdout.readline()  # an episode is finished
        time.sleep(0.3)  # the next ones are under way
        began = time.monotonic()
        process.send_signal(number)
        output, _ = process.communicate(timeout=60)
        assert time.monotonic() - began < 20
        assert process.returncode == 1
    assert f"stopped by {number.name}" in output
    folder = RunFolder(tmp_path / "run")
    assert 0 < len(folder.rows()) < 40
    interrupted = folder.failures()
    assert {failure["end_reason"] for failure in interrupted} == {"interrupted"}
    assert len(interrupted) <= 3
    assert list((tmp_path / "run" / "running").iterdir()) == []


def test_no_worker_outlives_a_run_that_was_killed(tmp_path):
    needs_proc()
    with start(tmp_path / "run", "processes", games=[BANDIT], trials=40, seconds=0.05) as process:
        assert process.stdout is not None
        process.stdout.readline()
        process.stdout.readline()
        workers = children(process.pid)
        assert len(workers) >= 2
        process.kill()
    assert is_soon(lambda: not any(map(is_running, workers)))


def test_ctrl_c_before_the_first_episode_is_one_sentence(tmp_path):
    """Ctrl-C goes to the whole group of processes, workers that are still importing included."""
    needs_unix()
    command = [sys.executable, "-m", "smartplay_tools", "eval", "--games", BANDIT, "--players", "random"]
    command += ["--trials", "40", "--workers", "2", "--out", str(tmp_path / "run")]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True
    ) as process:
        while not (tmp_path / "run" / "manifest.json").exists():
            time.sleep(0.01)
        os.killpg(process.pid, signal.SIGINT)
        printed, _ = process.communicate(timeout=120)
    assert process.returncode == 130
    assert "Traceback" not in printed
    assert "Stopped by SIGINT. The same command continues the run." in printed
