"""How long it takes to charge the records of a run under the rules of caches.

    python benchmarks/costs.py [--records 10000] [--processes 2]

The records are of bandit episodes with 50 calls each, in equal parts with full history, ten steps, ten steps with slack
and a cap of 2,000 tokens with slack. 200 are played, and each is read as often as it takes. The floor parses the same
records in this process alone.
"""

from __future__ import annotations

import argparse
import itertools
import os
import tempfile
import time
from pathlib import Path

from rich.console import Console
from rich.table import Table

import smartplay_tools as sp
from smartplay_tools.evaluation.costs.tariffs import charge_records, tariffs_of
from smartplay_tools.records import Record

RULES = ("openai-5-5", "openai-5-6", "anthropic-512", "anthropic-4096", "deepseek-4", "vllm")
WINDOWS = (
    {"history": None},
    {"history": 10},
    {"history": 10, "slack": 0.5},
    {"history": None, "prompt_tokens": 2_000, "slack": 0.5},
)
PLAYED = 200


def records(folder: Path, count: int) -> dict[str, Path]:
    """Play episodes, and name their records until there are enough."""
    paths = []
    for number in range(PLAYED):
        path = folder / f"{number}.jsonl"
        budget = sp.Budget(**WINDOWS[number % len(WINDOWS)])
        with sp.Episode("BanditTwoArmedHighLowFixed-v0", seed=number, budget=budget, transcript=path) as episode:
            sp.play(episode, sp.get_player("rule", seed=number))
        paths.append(path)
    return {str(number): path for number, path in zip(range(count), itertools.cycle(paths), strict=False)}


def processor_seconds() -> float:
    """The processor time of this process and of those that it has waited for."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--records", type=int, default=10_000)
    parser.add_argument("--processes", type=int, default=2)
    asked = parser.parse_args()
    table = Table("what", "records", "rules", "processes", "seconds", "processor seconds", "ms a record")
    with tempfile.TemporaryDirectory() as folder:
        named = records(Path(folder), asked.records)

        def row(what: str, rules: int, processes: int, began: float, used: float) -> None:
            took, used = time.perf_counter() - began, processor_seconds() - used
            figures = (f"{took:.1f}", f"{used:.1f}", f"{1000 * used / len(named):.2f}")
            table.add_row(what, f"{len(named):,}", str(rules), str(processes), *figures)

        began, used = time.perf_counter(), processor_seconds()
        charge_records(named, tariffs_of(RULES), {}, processes=asked.processes)
        row("charge", len(RULES), asked.processes, began, used)
        began, used = time.perf_counter(), processor_seconds()
        for path in named.values():
            _ = Record.read(path).events
        row("floor: parse", 0, 1, began, used)
    Console(width=100).print(table)


if __name__ == "__main__":
    main()
