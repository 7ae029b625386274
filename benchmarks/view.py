"""What the site costs with a large run: the time to list its episodes, the time of an answer, the memory.

    python benchmarks/view.py [--episodes 10000]

The run is made of the rows of a small one, so that nothing has to be played. `first` is the list after the folder has
changed, `again` the list of a folder that has not, both through HTTP as the page asks for it. The peer is Python's own
reading of the same rows (`json.loads` of every line of `results.jsonl`), the floor for whatever shows them. Memory is
what the list adds to the process, measured by `tracemalloc` in a run of its own, at its peak and afterwards.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
import tracemalloc
import urllib.request
from pathlib import Path

from rich.console import Console
from rich.table import Table

import smartplay_tools as sp
from smartplay_tools.web.site import ViewServer
from smartplay_tools.web.site.site_runs import SiteRun


def large_run(folder: Path, count: int) -> Path:
    """Make a run of `count` finished episodes from one that is played."""
    small, large = folder / "small", folder / "large"
    sp.evaluate(["Hanoi3Disk-v0"], ["rule"], out=small, trials=1, executor="inline")
    manifest = json.loads((small / "manifest.json").read_text(encoding="utf-8"))
    row = json.loads((small / "results.jsonl").read_text(encoding="utf-8"))
    keys = [f"{number:016x}" for number in range(count)]
    manifest["episodes"] = [{"key": key, "cell": 0, "trial": at, "seed": at} for at, key in enumerate(keys)]
    large.mkdir()
    (large / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    rows = (json.dumps({**row, "key": key, "trial": at}) + "\n" for at, key in enumerate(keys))
    (large / "results.jsonl").write_text("".join(rows), encoding="utf-8")
    return large


def floor(run: Path) -> float:
    """Return the seconds in which Python reads the rows as JSON."""
    began = time.perf_counter()
    with (run / "results.jsonl").open(encoding="utf-8") as lines:
        for line in lines:
            json.loads(line)
    return time.perf_counter() - began


def answers(run: Path) -> tuple[float, float, int]:
    """Return the seconds of the first list and of the same again, and the bytes of it."""
    with ViewServer([SiteRun(run, "large")]) as server:
        times = []
        for _ in range(2):
            began = time.perf_counter()
            with urllib.request.urlopen(f"{server.url}api/runs/large/episodes") as answer:
                size = len(answer.read())
            times.append(time.perf_counter() - began)
    return times[0], times[1], size


def memory(run: Path) -> tuple[int, int]:
    """Return the bytes that a list adds at its peak, and those that it keeps."""
    tracemalloc.start()
    shown = SiteRun(run, "large")
    shown.episodes()
    kept, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return peak, kept


def main() -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=10_000)
    count = parser.parse_args().episodes
    with tempfile.TemporaryDirectory() as folder:
        run = large_run(Path(folder), count)
        least = floor(run)
        first, again, size = answers(run)
        peak, kept = memory(run)
    table = Table(title=f"the site's list of {count:,} episodes")
    for heading in ("", "seconds", "of the floor"):
        table.add_column(heading, justify="left" if not heading else "right")
    for name, seconds in (("json.loads of the rows (floor)", least), ("first", first), ("again", again)):
        table.add_row(name, f"{seconds:.2f}", f"{seconds / least:.1f} x")
    console = Console()
    console.print(table)
    console.print(f"{size / 1e6:.1f} MB of JSON; memory {peak / 1e6:.0f} MB at its peak, {kept / 1e6:.0f} MB kept")


if __name__ == "__main__":
    main()
