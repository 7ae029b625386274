"""Where the process that directs a run saturates: how many finished episodes a second it can keep.

    python benchmarks/driver.py [--episodes 2000 20000]

Workers, on however many machines, hand in finished records; one process checks and moves each of them, adds its rows
and chooses the next episode. Here a simulated executor hands in a record of a played bandit game for every task at
once, so what is measured is that process alone, with the status file that it writes meanwhile. The floor writes the
same records and moves them, adds the same rows and timings, and does nothing else. File operations are counted by an
audit hook, in a run of their own, as is the memory that the process keeps for each episode.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
import tracemalloc
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, ClassVar

from rich.console import Console
from rich.table import Table

import smartplay_tools as sp
from smartplay_tools.evaluation.runs.attempt import Task, Times
from smartplay_tools.evaluation.runs.executors import Again, EndedAttempt, Executor, Take
from smartplay_tools.evaluation.runs.limits import RunLimits
from smartplay_tools.evaluation.runs.plan import make_cells, plan_episodes, player_key
from smartplay_tools.evaluation.runs.players import PlayerConfig
from smartplay_tools.evaluation.runs.roster import Roster
from smartplay_tools.evaluation.runs.run_options import RunOptions
from smartplay_tools.evaluation.runs.run_progress import StopFlag, following
from smartplay_tools.evaluation.runs.run_writer import RunWriter
from smartplay_tools.evaluation.runs.scheduler import Scheduler

GAME = "BanditTwoArmedHighLowFixed-v0"
OPERATIONS = ("open", "os.rename", "os.remove", "os.scandir", "os.listdir", "os.mkdir")


class Simulated(Executor):
    """An executor whose attempts take no time: every record is the one that was played, with the seed of its task."""

    played: ClassVar[list[bytes]] = []
    """The lines of the record; the first of them has the seed."""

    def __init__(self) -> None:
        self.stop = StopFlag()
        self.limits: RunLimits | None = None

    def run(self, take: Take, again: Again) -> Iterator[EndedAttempt]:
        """Hand in a record for every task."""
        while (task := take()) is not None:
            task.record.write_bytes(record_of(task))
            yield EndedAttempt(task, Times(1.0, 0.1, 0.2))


def record_of(task: Task) -> bytes:
    """Return the record of a task."""
    start = json.loads(Simulated.played[0])
    start["config"]["seed"] = task.planned.seed
    return json.dumps(start).encode() + b"\n" + b"".join(Simulated.played[1:])


def driven(folder: Path, episodes: int) -> float:
    """Return the seconds that a run of `episodes` simulated episodes takes."""
    plan = plan_episodes(make_cells([GAME], ["rule"], [sp.Budget()]), trials=episodes)
    players = {player_key(cell): PlayerConfig(name="rule") for cell in plan.cells}
    began = time.process_time()
    writer = RunWriter(folder)
    with writer.writing():
        manifest = plan.manifest(shard=None, prices={})
        writer.write_manifest(manifest)
        scheduler = Scheduler(writer, Roster(plan, players, {}, set()), manifest, RunOptions(), (), StopFlag())
        with following(writer, lambda snapshot: None):
            scheduler.play(Simulated(), plan.episodes)
        rows = scheduler.finish()
    seconds = time.process_time() - began
    assert len(rows) == episodes
    return seconds


def least(folder: Path, row: dict[str, Any], episodes: int) -> float:
    """Return the seconds in which `episodes` records are written and moved, with two rows added for each."""
    for name in ("running", "episodes"):
        (folder / name).mkdir(parents=True)
    text = b"".join(Simulated.played)
    began = time.process_time()
    for number in range(episodes):
        record = folder / "running" / f"{number}.jsonl"
        record.write_bytes(text)
        record.rename(folder / "episodes" / record.name)
        for name in ("timings", "results"):
            with (folder / f"{name}.jsonl").open("a", encoding="ascii") as file:
                file.write(json.dumps(row) + "\n")
    return time.process_time() - began


def operations(folder: Path, episodes: int) -> tuple[float, float]:
    """Return the file operations and the bytes of memory for each episode of a run."""
    seen: Counter[str] = Counter()
    counting = True

    def count(event: str, _: Any) -> None:
        if counting and event in OPERATIONS:
            seen[event] += 1

    sys.addaudithook(count)
    tracemalloc.start()
    driven(folder, episodes)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    counting = False
    return seen.total() / episodes, peak / episodes


def main() -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, nargs="+", default=[2000, 20_000])
    counts = parser.parse_args().episodes
    table = Table(title="one process directs a run")
    for heading in ("episodes", "floor (a second)", "kept (a second)", "of the floor"):
        table.add_column(heading, justify="right")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        sp.evaluate([GAME], ["rule"], out=folder / "small", trials=1, executor="inline")
        record = next((folder / "small" / "episodes").iterdir())
        Simulated.played = record.read_bytes().splitlines(keepends=True)
        row = json.loads((folder / "small" / "results.jsonl").read_text(encoding="utf-8"))
        for count in counts:
            floor = least(folder / f"floor{count}", row, count)
            seconds = driven(folder / f"run{count}", count)
            times = f"{seconds / floor:.1f} x"
            table.add_row(f"{count:,}", f"{count / floor:,.0f}", f"{count / seconds:,.0f}", times)
        files, memory = operations(folder / "counted", min(counts))
    console = Console()
    console.print(table)
    size = sum(map(len, Simulated.played)) / 1000
    console.print(
        f"for each episode: a record of {size:.0f} KB, {files:.1f} file operations, {memory / 1000:.1f} KB of memory"
    )


if __name__ == "__main__":
    main()
