"""A run on a Ray cluster whose machines are lost and added while it is played: nothing is lost, nothing is paid twice.

    python benchmarks/ray_nodes.py [--episodes 2000] [--changes 4]

Two raylets on this machine stand for two machines. Several times during the run, one of them is killed amid its episode
and a new one joins. The player writes a line for every call into a file of its own, as a provider does into its bill.
Afterwards every episode has one row, and every call on the bill is either in the record of a result or among the calls
whose fate the run shows as unknown: those that were under way when their machine was lost. The peer is the same run in
worker processes, which loses nothing because nothing is killed.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

import ray
from ray.cluster_utils import Cluster

import smartplay_tools as sp
from smartplay_tools.evaluation.run_folder.follower import run_snapshot
from smartplay_tools.evaluation.runs.run_options import RunProgress
from smartplay_tools.evaluation.runs.runner import Run
from smartplay_tools.players.rule import RulePlayer

GAME = "Hanoi3Disk-v0"
BILL = "SMARTPLAY_BENCHMARK_BILL"
"""The variable with the path of the bill, which the cluster's processes inherit."""


class Billed(RulePlayer):
    """The rule player, with a bill."""

    name = "billed"
    serves_many = True
    """As a model: everything is in the prompt, so it is not asked again what it has replied to."""

    def __init__(self, *, seed: int) -> None:
        super().__init__(seed=seed)
        self._seed = seed

    def reply(self, prompt: sp.Prompt) -> sp.Reply:
        """Write a line into the bill, and reply."""
        with Path(os.environ[BILL]).open("a", encoding="ascii") as bill:
            bill.write(f"{self._seed} {len(prompt.messages)}\n")
        return super().reply(prompt)


class Machines:
    """The cluster; at regular intervals one machine is lost and another one joins."""

    def __init__(self, every: int) -> None:
        self._every = every
        self.lost = 0
        self._cluster: Any = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
        # Of several nodes on one machine a driver joins any; here it has to be the one that stays.
        ray.init(address=self._cluster.address, log_to_driver=False, configure_logging=False)
        self._other = self._cluster.add_node(num_cpus=1)

    def change(self, progress: RunProgress) -> None:
        """Replace the other machine when it is time."""
        if progress.finished >= self._every * (self.lost + 1) and progress.finished < progress.planned:
            self.lost += 1
            self._cluster.remove_node(self._other, allow_graceful=False)
            self._other = self._cluster.add_node(num_cpus=1)

    def close(self) -> None:
        """Stop everything that was started."""
        ray.shutdown()
        self._cluster.shutdown()


def main() -> None:
    """Play, hold the bill against the records, and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=2000)
    parser.add_argument("--changes", type=int, default=4, help="how often a machine is lost and another one joins")
    asked = parser.parse_args()
    os.environ.pop("RAY_ADDRESS", None)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        os.environ[BILL] = str(folder / "bill")
        seconds, _ = _timed(folder / "processes", asked.episodes, executor="processes")
        (folder / "bill").unlink()
        machines = Machines(asked.episodes // (asked.changes + 1))
        try:
            on_ray, run = _timed(folder / "ray", asked.episodes, executor="ray", on_progress=machines.change)
        finally:
            machines.close()
        billed = Counter((folder / "bill").read_text(encoding="ascii").splitlines())
        spent = run_snapshot(run.folder).spending
        same = (folder / "ray" / "results.jsonl").read_bytes() == (folder / "processes" / "results.jsonl").read_bytes()
        outcome = {
            "episodes asked for": asked.episodes,
            "episodes with a result": len({row["key"] for row in run.rows}),
            "machines lost": machines.lost,
            "attempts that were interrupted": len(run.failures),
            "calls on the bill": billed.total(),
            "calls in the records of the results": sum(row["turns"] for row in run.rows),
            "calls whose fate is shown as unknown": spent.total.unknown_calls,
            "calls on the bill twice": sum(count - 1 for count in billed.values()),
            "replies paid for in attempts without a result": spent.other_attempts.replies,
            "the same bytes of results as in processes": same,
            "seconds": round(on_ray),
            "seconds in processes": round(seconds),
        }
    print(json.dumps(outcome, indent=2))
    whole = outcome["episodes with a result"] == asked.episodes and same
    paid_once = billed.total() <= outcome["calls in the records of the results"] + spent.total.unknown_calls
    if not (whole and paid_once and machines.lost):
        raise SystemExit("Something was lost or paid twice.")


def _timed(out: Path, episodes: int, **how: Any) -> tuple[float, Run]:
    began = time.perf_counter()
    run = sp.evaluate([GAME], {"billed": Billed}, out=out, trials=episodes, workers=2, **how)
    return time.perf_counter() - began, run


if __name__ == "__main__":
    main()
