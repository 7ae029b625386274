"""A thousand episodes at once on one MCP server: latency, calls a second, memory, processor time.

    python benchmarks/mcp_http.py [--episodes 1000] [--calls 5] [--clients 2]

The server is a separate process (`smartplay-tools serve mcp GAME --http`), and there are `--clients` client processes.
Every episode has a client of the official package with its own connection. All connect, then all begin at the same
moment, and each sends its next call when the last one is answered, which is the worst case. A client's call takes more
processor time than the server's answer, so with fewer free cores than processes, the latency includes the clients'
time; the server's processor time per call shows what the server alone could do.

No two episodes may be mixed, or the benchmark stops: before the clock runs, every client makes moves in an order that
no other has, and all its answers have to be those of the same game in this process.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import AsyncExitStack, contextmanager
from pathlib import Path
from typing import Any

import httpx2
from mcp import Client
from mcp.client.streamable_http import streamable_http_client
from rich.console import Console
from rich.table import Table

import smartplay_tools as sp

GAME, ACTIONS = "RockPaperScissorBasic-v0", ("Rock", "Paper", "Scissor")
MOVES = 7
"""The number of moves that each client makes first: enough for 2,187 orders."""
AT_ONCE = 50
"""The number of clients of a process that connect at the same time; their calls all begin at once."""


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--episodes", type=int, default=1000)
    parser.add_argument("--calls", type=int, default=5, help="of each episode")
    parser.add_argument("--clients", type=int, default=2, help="processes that hold the clients")
    parser.add_argument("--be-a-client", action="store_true", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.be_a_client:
        asyncio.run(be_a_client(asked.calls))
        return
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
    with served(1) as (server, places):
        empty = memory(server.pid)
        alone, _ = play(places, calls=200, clients=1)
    with served(asked.episodes) as (server, places):
        opened = memory(server.pid)
        before = processor_seconds(server.pid)
        times, seconds = play(places, asked.calls, asked.clients)
        spent, peak = processor_seconds(server.pid) - before, memory(server.pid, "VmHWM")
    made = len(times) + MOVES * asked.episodes
    table = Table("", "1 episode", f"{asked.episodes:,} at once", title="MCP over HTTP")
    table.add_row("latency p50, ms", f"{share(alone, 0.5):,.1f}", f"{share(times, 0.5):,.0f}")
    table.add_row("latency p95, ms", f"{share(alone, 0.95):,.1f}", f"{share(times, 0.95):,.0f}")
    table.add_row("latency p99, ms", f"{share(alone, 0.99):,.1f}", f"{share(times, 0.99):,.0f}")
    table.add_row("calls a second", f"{len(alone) / sum(alone):,.0f}", f"{len(times) / seconds:,.0f}")
    table.add_row("server memory, MiB", f"{empty / 1024:,.0f}", f"{opened / 1024:,.0f}, at most {peak / 1024:,.0f}")
    console = Console()
    console.print(table)
    console.print(
        f"{(opened - empty) / max(asked.episodes - 1, 1):.0f} KiB an episode; "
        f"{spent / made * 1e3:.1f} ms of the server's processor time a call, connecting included; "
        f"{len(times):,} calls from {asked.clients} client processes; {os.cpu_count()} cores"
    )


def share(times: Sequence[float], of: float) -> float:
    return sorted(times)[min(int(len(times) * of), len(times) - 1)] * 1e3


@contextmanager
def served(episodes: int) -> Iterator[tuple[subprocess.Popen[str], list[list[str]]]]:
    """Start a server with `episodes` open episodes; yield it with the address and the seed of each."""
    options = ["--http", "--port", "0", "--episodes", str(episodes), "--most", str(episodes), "--tool-calls", "none"]
    command = [sys.executable, "-m", "smartplay_tools", "serve", "mcp", GAME, *options]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert server.stdout is not None
        yield server, [server.stdout.readline().split()[::2] for _ in range(episodes)]
    finally:
        server.terminate()
        server.wait()


def play(places: list[list[str]], calls: int, clients: int) -> tuple[list[float], float]:
    """Have client processes play; return the time of each call, and the time of all together.

    Stop if a client was answered otherwise than in a game of its own.
    """
    command = [sys.executable, __file__, "--be-a-client", "--calls", str(calls)]
    processes = [
        subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) for _ in range(clients)
    ]
    for at, process in enumerate(processes):
        assert process.stdin is not None
        process.stdin.write(json.dumps(places[at::clients]) + "\n")
        process.stdin.flush()
    for process in processes:
        assert process.stdout is not None
        assert process.stdout.readline() == "connected\n"
    begun = time.perf_counter()
    for process in processes:
        assert process.stdin is not None
        process.stdin.write("go\n")
        process.stdin.flush()
    answers = [json.loads(_line(process)) for process in processes]
    seconds = time.perf_counter() - begun
    for process in processes:
        process.communicate()
    for at, (url, seed) in enumerate(places):
        _, texts = answers[at % clients][at // clients]
        if texts != game_of(int(seed), calls):
            raise SystemExit(f"The episode of {url} (seed {seed}) was answered otherwise than a game of its own.")
    return [taken for of_process in answers for times, _ in of_process for taken in times], seconds


def moves_of(seed: int) -> list[str]:
    """Return the moves of the client whose episode has this seed."""
    return [ACTIONS[seed // 3**place % 3] for place in range(MOVES)]


def game_of(seed: int, calls: int) -> list[str]:
    """Return what a client is told in an episode of its own."""
    with sp.Episode(GAME, seed=seed, context="host", budget=sp.Budget(tool_calls=None)) as episode:
        observe, act, _ = episode.functions()
        return [*(act(move) for move in moves_of(seed)), *(observe() for _ in range(calls))]


def _line(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    return process.stdout.readline()


async def be_a_client(calls: int) -> None:
    """Connect a client to each address that comes in; on "go", play with all.

    Print for each client the seconds of its calls, and all that it was told.
    """
    places: list[list[str]] = json.loads(sys.stdin.readline())
    connected, begin = asyncio.Semaphore(AT_ONCE), asyncio.Event()
    waiting = len(places)

    async def one(url: str, seed: str) -> tuple[list[float], list[str]]:
        nonlocal waiting
        async with AsyncExitStack() as stack:
            async with connected:
                # No certificates are needed on this machine, and reading them takes longer than a game.
                http = await stack.enter_async_context(httpx2.AsyncClient(trust_env=False, verify=False, timeout=600))
                client = await stack.enter_async_context(Client(streamable_http_client(url, http_client=http)))
                await client.list_tools()
                texts = [text_of(await client.call_tool("act", {"action": move})) for move in moves_of(int(seed))]
            waiting -= 1
            if not waiting:
                print("connected", flush=True)
                await asyncio.to_thread(sys.stdin.readline)
                begin.set()
            await begin.wait()
            times = []
            for _ in range(calls):
                begun = time.perf_counter()
                result = await client.call_tool("observe")
                times.append(time.perf_counter() - begun)
                texts.append(text_of(result))
            return times, texts

    print(json.dumps(await asyncio.gather(*(one(*place) for place in places))), flush=True)


def text_of(result: Any) -> str:
    return str(result.content[0].text)


def memory(process: int, what: str = "VmRSS") -> int:
    """Resident memory of a process now, or at most so far ("VmHWM"), in KiB; from Linux's /proc."""
    lines = Path(f"/proc/{process}/status").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(what))


def processor_seconds(process: int) -> float:
    fields = Path(f"/proc/{process}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


if __name__ == "__main__":
    main()
