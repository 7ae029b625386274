"""Runs on Ray clusters: one that is named, where a worker is killed, and one that the run itself starts."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.run_folder.folder import RunFolder
from smartplay_tools.evaluation.run_folder.follower import run_snapshot
from tests.processes import printed_by

pytest.importorskip("ray", reason="the extra `ray` is not installed")
pytestmark = pytest.mark.slow

BANDIT, HANOI = "BanditTwoArmedHighLowFixed-v0", "Hanoi3Disk-v0"
ROOT = Path(__file__).parents[2]

CLUSTER = """
import sys
from ray.cluster_utils import Cluster
cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 2, "include_dashboard": False})
print(cluster.address, flush=True)
sys.stdin.read()
cluster.shutdown()
"""


@pytest.fixture(scope="module")
def named_cluster() -> Iterator[str]:
    command = [sys.executable, "-c", CLUSTER]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        address = process.stdout.readline().strip()
        assert address
        yield address


# Ray leaves threads and sockets behind that raise warnings, so it runs in a separate process.
SCRIPT = """
import os, signal, sys
from pathlib import Path
import smartplay_tools as sp
from tests.evaluation.players import FirstMoves

class KilledOnce(FirstMoves):
    def before(self, prompt):
        mark = Path(self.options["marks"]) / "killed"
        if not mark.exists() and len(prompt.messages) > 20:
            mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)

if __name__ == "__main__":
    out, cap = Path(sys.argv[1]), int(sys.argv[2]) or None
    options = {"marks": str(out.parent)}
    run = sp.evaluate([%r, %r], {"first": KilledOnce}, out=out, trials=2, executor=sys.argv[3], workers=2,
                      run_tokens=cap, player_options=options, budgets=sp.Budget(reply_tokens=100, tool_calls=15))
    print(run.complete, len(run.rows), [row["end_reason"] for row in run.failures], run.cap_reached)
"""


def lines_of(script: str, tmp_path: Path, *arguments: str, address: str = "") -> list[str]:
    (tmp_path / "script.py").write_text(script)
    paths = os.pathsep.join([str(tmp_path), str(ROOT), *sys.path])
    environment = {**os.environ, "PYTHONPATH": paths, "RAY_ADDRESS": address}
    command = [sys.executable, str(tmp_path / "script.py"), *arguments]
    done = printed_by(*command, env=environment)
    return done.strip().splitlines()


def run(tmp_path: Path, name: str, cap: int = 0, executor: str = "ray", address: str = "") -> str:
    arguments = str(tmp_path / name), str(cap), executor
    return lines_of(SCRIPT % (BANDIT, HANOI), tmp_path, *arguments, address=address)[-1]


def test_a_killed_worker_costs_no_row_and_makes_none_twice(tmp_path, named_cluster):
    assert run(tmp_path, "run", address=named_cluster) == "True 4 ['interrupted'] False"
    rows = RunFolder(tmp_path / "run").rows()
    assert len({row["key"] for row in rows}) == 4
    # With the mark there nobody is killed: the same run, undisturbed and on one machine, has the same bytes.
    assert run(tmp_path, "undisturbed", executor="inline") == "True 4 [] False"
    first, second = (tmp_path / name / "results.jsonl" for name in ("run", "undisturbed"))
    assert first.read_bytes() == second.read_bytes()
    # The replies that had arrived went on to the machine that runs the command; the episode continued behind them.
    folder = RunFolder(tmp_path / "run")
    resumed = [e for row in rows for e in sp.read_transcript(folder.transcript(row["key"])) if e["event"] == "resume"]
    assert len(resumed) == 1
    assert run_snapshot(folder).spending.other_attempts.replies == 0


def test_a_cap_holds_on_a_cluster(tmp_path, named_cluster):
    (tmp_path / "killed").touch()
    assert run(tmp_path, "run", cap=20_000, address=named_cluster).endswith("True")
    assert 0 < run_snapshot(RunFolder(tmp_path / "run")).spending.total.tokens <= 20_000


ASKS = """
from smartplay_tools.context.compaction import asked

class Asks:
    def compact(self, history, room):
        question = [*history, {"role": "user", "content": "Sum up."}]
        summed = lambda ask: [history[0], {"role": "user", "content": ask(question)["content"]}]
        return asked(summed) if room.count(history) > 300 else history
"""


def test_processes_and_a_cluster_play_the_records_of_chains_and_of_a_compactor_that_asks(tmp_path, named_cluster):
    (tmp_path / "asks.py").write_text(ASKS)
    asked = f"--games {BANDIT} --players rule-notes --trials 6 --carry notes --chain 3 --notes-tokens 100 --workers 2"
    asked += " --history none --prompt-tokens 900 --strategy asks.py:Asks"
    played, environment = [], {**os.environ, "RAY_ADDRESS": named_cluster}
    for executor in ("inline", "processes", "ray"):
        out = tmp_path / executor
        command = [sys.executable, "-m", "smartplay_tools", "eval", *asked.split(), "--executor", executor]
        command += ["--out", str(out)]
        printed_by(*command, cwd=tmp_path, env=environment)
        folder = RunFolder(out)
        assert all(row["questions"] > 0 and row["end_reason"] == "rollout" for row in folder.rows())
        played.append({row["key"]: folder.transcript(row["key"]).read_bytes() for row in folder.rows()})
    assert len(played[0]) == 6
    assert played[0] == played[1] == played[2]


RETRIED_AND_LOST = """
import gc, os, sys
from pathlib import Path
import ray
import smartplay_tools as sp
from smartplay_tools.errors import EngineError
from smartplay_tools.evaluation.runs.executors.ray import RayExecutor
from tests.evaluation.players import BrokenOnce

if __name__ == "__main__":
    out = Path(sys.argv[1])
    run = sp.evaluate([%r], {"stumbles": BrokenOnce}, out=out, trials=2, executor="ray", workers=2, run_tokens=10**7,
                      player_options={"marks": str(out.parent)}, budgets=sp.Budget(reply_tokens=100))
    print(run.complete, [row["end_reason"] for row in run.failures], ray.is_initialized())

    def lose(progress):
        if progress.finished:
            ray.kill(next(each for each in gc.get_objects() if type(each) is RayExecutor)._records)
    os.environ["RAY_ADDRESS"] = sys.argv[2]
    try:
        sp.evaluate([%r], ["rule"], out=f"{out}-lost", trials=9, executor="ray", workers=1, on_progress=lose)
    except EngineError as error:
        print(error)
"""


def test_a_failed_episode_is_tried_again_in_the_cluster_started_for_it_and_a_lost_actor_loses_no_row(
    tmp_path, named_cluster
):
    retried, *_, lost = lines_of(RETRIED_AND_LOST % (HANOI, HANOI), tmp_path, str(tmp_path / "run"), named_cluster)
    assert retried == "True ['player_error', 'player_error'] False"
    assert lost.startswith("The Ray cluster has lost what this run needs (ActorDiedError)")
    assert "of 9 episodes that are finished are kept; the same command continues the run." in lost
