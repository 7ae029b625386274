"""What many episodes cost in one process: memory, file handles, threads, and the time of a call.

    python benchmarks/ten_thousand.py [--episodes 10,1000,10000] [--records 2000]

Each row is a process of its own, with at most 1,024 open files. Its episodes, of five games in turn, are all open at
the same time, each with a transcript, and each answers three calls of `acall`, the calls of all episodes at once. Times
are microseconds of the processor, in all threads. "made" includes the record's first event; the last column is `call`
in a plain loop over the same episodes, the floor of the column before it.

A second table measures what is read and written around episodes: the next attempt at an episode that has failed before,
and the prompts rebuilt from a record, under a cap and without one, for which the messages that are shown grow with the
square of the turns.

A third table is of a finished run of bandit episodes of three calls each, read by the commands `replay` and `report`:
milliseconds an episode, from the start of the command to its end. The floor parses the same records, in this process.
"""

from __future__ import annotations

import argparse
import asyncio
import dataclasses
import gc
import json
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
from smartplay_tools.evaluation.runs.run_writer import RunWriter
from smartplay_tools.records import sent_prompts
from smartplay_tools.transcript.events import Event

GAMES = ("BanditTwoArmedHighLowFixed-v0", "RockPaperScissorBasic-v0", "Hanoi3Disk-v0", "MessengerL2-v0", "Crafter-v0")
CALLS, HANDLES = 3, 1024
ENDLESS = "RockPaperScissorBasic-v0"
ATTEMPTS, TURNS = (10, 1_000, 8_000), (100, 500, 1_500)


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


def attempts() -> list[tuple[str, str, float]]:
    """Where the next attempt's record belongs, after a number of failed ones; seconds for a thousand of them."""
    rows = []
    for failed in ATTEMPTS:
        with tempfile.TemporaryDirectory() as name:
            folder = RunWriter(name)
            (folder.path / "attempts").mkdir()
            for number in range(failed):
                (folder.path / "attempts" / f"{number % 1_000:016x}.{number // 1_000 + 1}.jsonl").touch()
            with folder.writing():
                began = time.process_time()
                for number in range(1_000):
                    folder.next_attempt(f"{number:016x}")
                rows.append(("the next attempt's record", f"{failed:,} failed", time.process_time() - began))
    return rows


def rebuilt() -> list[tuple[str, str, float]]:
    """The prompts of a record, rebuilt; seconds for a thousand of them."""
    rows = []
    for cap in (2_000, None):
        for turns in TURNS:
            events: list[Event] = []
            spec = dataclasses.replace(sp.GAMES[ENDLESS], rollout=10**9)
            budget = sp.Budget(history=None, prompt_tokens=cap, tool_calls=turns)
            with sp.Episode(spec, seed=1, budget=budget, transcript=events) as episode:
                sp.play(episode, sp.get_player("random", seed=1))
            began = time.process_time()
            assert all(sent.sha256 == sent.recorded_sha256 for sent in sent_prompts(events))
            took = (time.process_time() - began) / turns * 1_000
            rows.append((f"a prompt rebuilt, cap {cap}", f"{turns:,} turns", took))
    return rows


def around() -> Table:
    """What is read and written around episodes."""
    table = Table("what", "of", "microseconds each", title="Around episodes", title_justify="left")
    for what, of, seconds in (*attempts(), *rebuilt()):
        table.add_row(what, of, f"{seconds * 1e3:,.1f}")
    return table


def read_again(records: int) -> Table:
    """What a finished run of `records` episodes costs to replay, and to write as a page."""
    columns = ("episodes", "floor", "replay", "in one process", "report", "in one process")
    table = Table(*columns, title="A run read again, milliseconds an episode", title_justify="left")
    with tempfile.TemporaryDirectory() as name:
        run, page = Path(name, "run"), Path(name, "page.html")
        sp.evaluate([GAMES[0]], ["random"], out=run, trials=records, budgets=sp.Budget(tool_calls=CALLS))
        began = time.perf_counter()
        for record in (run / "episodes").iterdir():
            for line in record.read_bytes().splitlines():
                json.loads(line)
        took = [time.perf_counter() - began]
        for command in (["replay", str(run)], ["report", str(run), "--episodes", "all", "--out", str(page)]):
            for workers in ([], ["--workers", "1"]):
                began = time.perf_counter()
                subprocess.run(
                    [sys.executable, "-m", "smartplay_tools", *command, *workers], check=True, stdout=subprocess.DEVNULL
                )
                took.append(time.perf_counter() - began)
    table.add_row(f"{records:,}", *(f"{seconds / records * 1e3:,.2f}" for seconds in took))
    return table


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", default="10,1000,10000", help="how many episodes are open at once, row by row")
    parser.add_argument("--records", type=int, default=2_000, help="how many episodes the run has that is read again")
    parser.add_argument("--live", type=int, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.live is not None:
        live(asked.live)
        return
    console = Console(width=120)
    console.print(many([int(count) for count in asked.episodes.split(",")]))
    console.print(around())
    console.print(read_again(asked.records))


if __name__ == "__main__":
    main()
