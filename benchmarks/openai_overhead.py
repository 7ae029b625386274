"""The overhead of a model call: the microseconds of our code and of the client's.

    python benchmarks/openai_overhead.py

A long game (Rock Paper Scissors, 2,000 steps, prompts of at most 4,096 tokens) is played through the `openai` client
against a local endpoint in another process. Ours is the time inside `prompt()` and `receive()`, and the time to make
the request's body; the client's is the time in `create`, of which the server's is what the same request takes over a
bare socket. The client's typed arguments are timed on the same prompts.

Then many games of Hanoi are played at the same time, through one client on one event loop.
"""

from __future__ import annotations

import asyncio
import dataclasses
import http.client
import json
import os
import statistics
import subprocess
import sys
import time
from urllib.parse import urlsplit

import openai
from rich.console import Console
from rich.table import Table

import smartplay_tools as sp
from smartplay_tools.games import get_spec

STEPS = int(os.environ.get("STEPS", "2000"))
BUDGET = sp.Budget(prompt_tokens=4096, history=200, tool_calls=None)
"""200 steps are more than the prompt holds: the cap decides."""
SAMPLED = 100
"""At regular intervals, the same request is timed in the other two ways."""


def main() -> None:
    command = [sys.executable, "-m", "smartplay_tools", "serve", "openai", "--port", "0", "--player", "rule"]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env={**os.environ, "COLUMNS": "200"})
    try:
        base_url = server.stdout.readline().split()[0]
        for interface in ("chat completions", "responses"):
            measure(interface, base_url)
        many_at_once(base_url)
    finally:
        server.terminate()
        server.wait()


def measure(interface: str, base_url: str) -> None:
    chat = interface == "chat completions"
    player = sp.get_player(f"{'openai' if chat else 'openai-responses'}:rule", base_url=base_url)
    http_client = openai.DefaultHttpxClient(trust_env=False)
    client = openai.OpenAI(base_url=base_url, api_key="none", http_client=http_client)
    typed = client.chat.completions.create if chat else client.responses.create
    times: dict[str, list[float]] = {
        name: [] for name in ("prompt()", "receive()", "request", "client", "typed", "bare")
    }

    def timed(name: str, function, *arguments, **options):
        start = time.perf_counter()
        result = function(*arguments, **options)
        times[name].append(time.perf_counter() - start)
        return result

    spec = dataclasses.replace(get_spec("RockPaperScissorBasic-v0"), rollout=STEPS)
    with player, client, sp.Episode(spec, seed=7, budget=BUDGET) as episode:
        conversation = sp.Conversation(episode, player=player.name)
        while (prompt := timed("prompt()", conversation.prompt)) is not None:
            body = timed("request", player.request, prompt)
            reply = timed("client", player.reply, prompt)
            if len(times["client"]) % SAMPLED == 0:
                timed("typed", typed, **body)
                timed("bare", bare, base_url, chat, body)
            timed("receive()", conversation.receive, reply)
    report(interface, times)


def bare(base_url: str, chat: bool, body: dict[str, object]) -> bytes:
    where = urlsplit(base_url)
    connection = http.client.HTTPConnection(where.hostname or "", where.port)
    path = "/v1/chat/completions" if chat else "/v1/responses"
    connection.request("POST", path, json.dumps(body), {"content-type": "application/json"})
    answer = connection.getresponse().read()
    connection.close()
    return answer


def many_at_once(base_url: str) -> None:
    async def play(seed: int, player: sp.AsyncPlayer) -> int:
        with sp.Episode("Hanoi3Disk-v0", seed=seed, budget=sp.Budget(prompt_tokens=1000)) as episode:
            return (await sp.aplay(episode, player)).turns

    async def play_all(games: int) -> tuple[int, float]:
        async with sp.get_player("openai:rule", base_url=base_url) as player:
            start = time.perf_counter()
            turns = await asyncio.gather(*(play(seed, player) for seed in range(games)))
            return sum(turns), time.perf_counter() - start

    table = Table("games at once", "requests", "seconds", "requests per second", title="one client, one event loop")
    for games in (1, 20, 200):
        requests, seconds = asyncio.run(play_all(games))
        table.add_row(str(games), str(requests), f"{seconds:.1f}", f"{requests / seconds:,.0f}")
    Console().print(table)


def report(interface: str, times: dict[str, list[float]]) -> None:
    quarter = len(times["client"]) // 4
    table = Table(
        "microseconds per call", "median", "first quarter", "last quarter", title=f"{interface}, {STEPS} steps"
    )
    ours = [sum(parts) for parts in zip(times["prompt()"], times["receive()"], strict=False)]
    rows = {
        "ours: prompt() + receive()": ours,
        "ours: the request's body": times["request"],
        "client and server": [whole - body for whole, body in zip(times["client"], times["request"], strict=True)],
        "  the same with typed arguments": times["typed"],
        "  the same over a bare socket": times["bare"],
    }
    for name, values in rows.items():
        cut = min(quarter, max(len(values) // 4, 1))
        parts = (values, values[:cut], values[-cut:])
        table.add_row(name, *(f"{statistics.median(part) * 1e6:,.0f}" for part in parts))
    Console().print(table)


if __name__ == "__main__":
    main()
