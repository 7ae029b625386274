"""What the runner costs: how busy it keeps the processors, and how many waiting episodes it holds at once.

    python benchmarks/runner.py [--episodes 200] [--concurrent 300]

Processes: Crafter episodes under the process executor, with the package's fast engine and with PyPI's crafter as the
peer. `in episodes` is the processor time of all attempts as a share of processors x wall time, start of the workers
included; `in the game` is the part of it inside reset and step. Where the game is fast, keeping the record and the
window is most of an episode; `crafter` itself shows what is left of the processors for a game that is not.

Async: episodes of one game against the package's own endpoint on loopback, in a process of its own that takes a second
for every answer, as a model does; `ideal` is the time of the longest episode's answers alone.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import multiprocessing
import os
import socket
import tempfile
import time
from collections.abc import Sequence

from rich.console import Console
from rich.table import Table

import smartplay_tools as sp
from smartplay_tools.players.scripted import RandomPlayer

WORKERS = 2
"""The processors that the shares are of."""

PACE = 1.0
"""Seconds that the endpoint takes for an answer."""


def processes(episodes: int, engine: str, player: str) -> Sequence[str]:
    """Run Crafter episodes in worker processes and return a table row."""
    with tempfile.TemporaryDirectory() as folder:
        began = time.perf_counter()
        run = sp.evaluate(
            ["Crafter-v0"], [player], out=folder, trials=episodes, engine=engine, executor="processes", workers=WORKERS
        )
        wall = time.perf_counter() - began
        times = run.folder.timings()
        steps = sum(row["steps"] for row in run.rows)
    capacity = WORKERS * wall
    busy = sum(row["processor_seconds"] for row in times) / capacity
    game = sum(row["game_seconds"] for row in times) / capacity
    return engine, player, str(episodes), f"{wall:.1f} s", f"{steps / wall:,.0f}", f"{busy:.0%}", f"{game:.0%}"


class SlowRandom(RandomPlayer):
    """Random play with a model's pace."""

    name = "slow-random"

    async def areply(self, prompt: sp.Prompt) -> sp.Reply:
        """Wait, then act."""
        await asyncio.sleep(PACE)
        return super().reply(prompt)


def serve(port: int) -> None:
    """Serve the slow player: in a process of its own, as a model is."""
    from smartplay_gateway import LocalEndpoint

    LocalEndpoint(SlowRandom(), port=port).run()


def waiting(concurrent: int) -> Sequence[str]:
    """Run episodes against a local endpoint, all at once, and return a table row."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    server = multiprocessing.get_context("spawn").Process(target=serve, args=(port,))
    server.start()
    try:
        wait_for(port)
        with tempfile.TemporaryDirectory() as folder:
            began = time.perf_counter()
            run = sp.evaluate(
                ["BanditTwoArmedHighLowFixed-v0"],
                ["openai:slow-random"],
                out=folder,
                trials=concurrent,
                workers=concurrent,
                player_options={"base_url": f"http://127.0.0.1:{port}/v1"},
            )
            wall = time.perf_counter() - began
            calls = sum(row["turns"] for row in run.rows)
            finished = [row["seconds"] for row in run.folder.timings()]
    finally:
        server.terminate()
        server.join()
    in_flight = sum(finished) / wall
    ideal = PACE * max(row["turns"] for row in run.rows)
    shown = f"{wall:.1f} s", f"{ideal:.1f} s", f"{calls / wall:,.0f}", f"{in_flight:.0f}"
    return str(concurrent), str(len(run.rows)), str(len(run.failures)), *shown


def wait_for(port: int) -> None:
    """Wait until a server listens."""
    while True:
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), 1):
            return
        time.sleep(0.1)


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--episodes", type=int, default=200)
    arguments.add_argument("--concurrent", type=int, default=300)
    asked = arguments.parse_args()
    console = Console()
    headings = ("engine", "player", "episodes", "wall", "steps/s", "in episodes", "in the game")
    table = Table(*headings, title=f"Process executor, {WORKERS} workers, {os.cpu_count()} processors")
    table.add_row(*processes(asked.episodes, "fast", "random"))
    table.add_row(*processes(asked.episodes, "crafter", "random"))
    console.print(table)
    headings = ("asked at once", "finished", "failed", "wall", "ideal", "calls/s", "in flight, mean")
    table = Table(*headings, title=f"Async executor, local endpoint, answers in {PACE} s")
    table.add_row(*waiting(asked.concurrent))
    console.print(table)


if __name__ == "__main__":
    main()
