"""What many episodes cost in one process: memory, file handles, threads, and the time of a call.

    python benchmarks/ten_thousand.py [--episodes 10,1000,10000]

Each row is a process of its own, with at most 1,024 open files. Its episodes, of five games in turn, are all open at
the same time, each with a transcript, and each answers three calls of `acall`, the calls of all episodes at once. Times
are microseconds of the processor, in all threads. "made" includes the record's first event; the last column is `call`
in a plain loop over the same episodes, the floor of the column before it.
"""

from __future__ import annotations

import argparse
import asyncio
import gc
import os
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

from rich.console import Console
from rich.table import Table

import smartplay_tools as sp
from smartplay_tools.context.tokens import get_tokenizer

GAMES = ("BanditTwoArmedHighLowFixed-v0", "RockPaperScissorBasic-v0", "Hanoi3Disk-v0", "MessengerL2-v0", "Crafter-v0")
CALLS, HANDLES = 3, 1024


def resident() -> float:
    """The memory of this process, in KiB; not a number where the system does not tell."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    except FileNotFoundError:
        return float("nan")
    return pages * os.sysconf("SC_PAGE_SIZE") / 1024


def handles() -> str:
    """How many files this process has open."""
    folder = Path("/proc/self/fd")
    return str(len(list(folder.iterdir()))) if folder.exists() else "not known"


def limit_handles() -> None:
    """Let this process have at most `HANDLES` open files, where the system has such a limit."""
    if sys.platform != "win32":
        import resource

        _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        resource.setrlimit(resource.RLIMIT_NOFILE, (HANDLES, hard))


async def answer_all(episodes: list[sp.Episode]) -> int:
    """Answer the calls of all episodes at once; return the most threads that there were."""
    most = 0

    async def play(episode: sp.Episode) -> None:
        nonlocal most
        for _ in range(CALLS):
            await episode.acall("act", {"action": "1"})
            most = max(most, threading.active_count())

    await asyncio.gather(*map(play, episodes))
    return most


def live(count: int) -> None:
    """Print the row of a number of episodes."""
    limit_handles()
    get_tokenizer().count("The tokenizer is loaded before anything is measured.")
    for game in GAMES:
        sp.Episode(game, seed=0).close()
    gc.collect()
    before = resident()
    with tempfile.TemporaryDirectory() as folder:
        made = time.process_time()
        episodes = [
            sp.Episode(GAMES[n % len(GAMES)], seed=n, context="host", transcript=Path(folder, f"{n}.jsonl"))
            for n in range(count)
        ]
        for episode in episodes:
            episode.begin()
        made = time.process_time() - made
        began = time.process_time()
        threads = asyncio.run(answer_all(episodes))
        shared = time.process_time() - began
        memory, files = (resident() - before) / count, handles()
        began = time.process_time()
        for episode in episodes:
            episode.call("act", {"action": "1"})
        plain = time.process_time() - began
        for episode in episodes:
            episode.close()
    figures = made / count, shared / count / CALLS, plain / count
    print(f"{memory:,.0f}", files, threads, *(f"{seconds * 1e6:,.0f}" for seconds in figures), sep="\t")


def many(counts: list[int]) -> Table:
    """A row for each number of episodes that are open at once."""
    columns = ("episodes", "KiB an episode", "handles", "threads", "made", "acall", "call")
    table = Table(*columns, title="Episodes that are open at once; times in microseconds", title_justify="left")
    for count in counts:
        command = [sys.executable, __file__, "--live", str(count)]
        line = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout.strip()
        table.add_row(f"{count:,}", *line.split("\t"))
    return table


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", default="10,1000,10000", help="how many episodes are open at once, row by row")
    parser.add_argument("--live", type=int, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.live is not None:
        live(asked.live)
        return
    Console(width=120).print(many([int(count) for count in asked.episodes.split(",")]))


if __name__ == "__main__":
    main()
