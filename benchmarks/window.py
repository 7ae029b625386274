"""Two hundred agents at once at one window endpoint: latency of model requests and tool calls, memory, mixed episodes.

    python benchmarks/window.py [--agents 200] [--clients 2] [--interface chat]

The endpoint is a separate process (`smartplay-tools serve window GAME --out FOLDER`) with the rule player, so no
model's time is measured, and there are `--clients` client processes. All agents begin at the same moment, and each
sends its next request when the last one is answered, which is the worst case. With fewer free cores than processes,
latency includes the clients' time.

Every agent has to win its own game, no prompt may exceed the cap, and no two episodes may be mixed, or the benchmark
stops: the player names the world in every reply (`named_rule.py`), every call has an id of its own, which the answer
has to have, and the record of a handle has to hold what its agent was told and did, in the same order.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx2
from mcp_http import memory, processor_seconds, share
from named_rule import words_of
from rich.console import Console
from rich.table import Table

import smartplay_tools as sp
from smartplay_tools.episode import tool_specs

GAME, CAP, SECONDS = "Hanoi3Disk-v0", 700, 600
PLAYER = f"{Path(__file__).with_name('named_rule.py')}:NamedRule"

Turn = list[Any]
"""What a reply says, and its calls, each as its name, its arguments and the result."""


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--agents", type=int, default=200)
    parser.add_argument("--clients", type=int, default=2, help="processes that hold the agents")
    parser.add_argument("--interface", choices=("chat", "messages"), default="chat")
    parser.add_argument("--be-a-client", action="store_true", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.be_a_client:
        asyncio.run(be_a_client(asked.interface))
        return
    with tempfile.TemporaryDirectory() as folder, served(asked.agents, Path(folder)) as (server, places):
        opened, before = memory(server.pid), processor_seconds(server.pid)
        asking, calling, played, seconds = play(places, asked.clients, asked.interface)
        spent, peak = processor_seconds(server.pid) - before, memory(server.pid, "VmHWM")
        check(Path(folder) / "run", places, played)
    table = Table("", "model requests", "tool calls", title=f"{asked.agents:,} agents at one window endpoint")
    for name, of in (("p50", 0.5), ("p99", 0.99)):
        table.add_row(f"latency {name}, ms", f"{share(asking, of):,.0f}", f"{share(calling, of):,.0f}")
    table.add_row("number", f"{len(asking):,}", f"{len(calling):,}")
    console = Console()
    console.print(table)
    console.print(
        f"{seconds:.1f} s; server memory {opened / 1024:,.0f} MiB before, at most {peak / 1024:,.0f}; "
        f"{spent / (len(asking) + len(calling)) * 1e3:.1f} ms of its processor time a request; "
        f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"
    )


@contextmanager
def served(agents: int, folder: Path) -> Iterator[tuple[subprocess.Popen[str], list[list[str]]]]:
    """Start an endpoint; yield it with its address, and the model, the MCP address and the seed of each agent."""
    options = ["--port", "0", "--episodes", str(agents), "--prompt-tokens", str(CAP), "--out", str(folder / "run")]
    command = [sys.executable, "-m", "smartplay_tools", "serve", "window", GAME, "--player", PLAYER, *options]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        assert server.stdout is not None
        base_url = server.stdout.readline().split()[1]
        lines = [server.stdout.readline().split() for _ in range(agents)]
        threading.Thread(target=server.stdout.read, daemon=True).start()  # what it prints of each end
        yield server, [[base_url, line[1], line[3], line[5]] for line in lines]
    finally:
        server.terminate()
        server.wait()


def play(
    places: list[list[str]], clients: int, interface: str
) -> tuple[list[float], list[float], dict[str, list[Turn]], float]:
    """Have client processes play.

    Return the seconds of each request and of each call, the turns of each model, and the seconds of all together.
    """
    command = [sys.executable, __file__, "--be-a-client", "--interface", interface]
    pipe = subprocess.PIPE
    processes = [subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) for _ in range(clients)]
    begun = time.perf_counter()
    for at, process in enumerate(processes):
        assert process.stdin is not None
        process.stdin.write(json.dumps(places[at::clients]))
        process.stdin.close()
    of_all = [json.load(process.stdout) for process in processes if process.stdout is not None]
    seconds = time.perf_counter() - begun
    for process in processes:
        process.wait()
    asking = [taken for times, _, _ in of_all for taken in times]
    calling = [taken for _, times, _ in of_all for taken in times]
    return asking, calling, {model: turns for _, _, played in of_all for model, turns in played.items()}, seconds


def check(run: Path, places: list[list[str]], played: dict[str, list[Turn]]) -> None:
    """Stop if an agent has not won its own game under the cap, or if a record is not what its agent saw."""
    handles = json.loads((run / "handles.json").read_text())
    records = {f"smartplay/{handles[path.stem]}": sp.read_transcript(path) for path in run.glob("episodes/*.jsonl")}
    largest = max(event["tokens"] for events in records.values() for event in events if event["event"] == "view")
    scores = [events[-1]["result"]["score"] for events in records.values()]
    if scores != [3.0] * len(places) or largest > CAP:
        raise SystemExit(f"{scores.count(3.0)} of {len(places)} agents have won; the largest prompt has {largest}.")
    for _, model, _, seed in places:
        if played[model] != turns_of(records[model]) or {words for words, _ in played[model]} != {words_of(int(seed))}:
            raise SystemExit(f"The record of {model} (seed {seed}) is not what its agent was told and did.")


def turns_of(events: list[Any]) -> list[Turn]:
    """Return the turns of a record."""
    turns: list[Turn] = []
    for event in events:
        if event["event"] == "message":
            turns.append([event["message"]["content"], []])
        elif event["event"] == "call":
            turns[-1][1].append([event["name"], json.loads(event["arguments"]), event["text"]])
    return turns


async def be_a_client(interface: str) -> None:
    """Play with all agents at once; print what each request and each call took, and the turns of each agent."""
    places = json.load(sys.stdin)
    limits = httpx2.Limits(max_connections=None)
    asking: list[float] = []
    calling: list[float] = []
    async with httpx2.AsyncClient(trust_env=False, verify=False, timeout=SECONDS, limits=limits) as http:
        agents = [Agent(http, interface, *place[:3], asking, calling) for place in places]
        await asyncio.gather(*(agent.play() for agent in agents))
    print(json.dumps([asking, calling, {agent.model: agent.turns for agent in agents}]))


class Agent:
    """A loop that keeps its messages, sends all of them, and runs the calls that come back."""

    def __init__(
        self,
        http: httpx2.AsyncClient,
        interface: str,
        base_url: str,
        model: str,
        mcp_url: str,
        asking: list[float],
        calling: list[float],
    ) -> None:
        self._http, self._mcp_url, self._asking, self._calling = http, mcp_url, asking, calling
        self._is_chat = interface == "chat"
        self._url = f"{base_url}/{'chat/completions' if self._is_chat else 'messages'}"
        kind: Any = "openai" if self._is_chat else "anthropic"
        tools = [sp.schema(tool, kind) for tool in tool_specs(GAME)]
        self._messages: list[Any] = [{"role": "user", "content": "Play."}]
        self._body = {"model": model, "messages": self._messages, "tools": tools, "max_tokens": 1000}
        self.model, self._made = model, 0
        self.turns: list[Turn] = []

    async def play(self) -> None:
        """Play until a reply has no call."""
        while True:
            answer = await self._post(self._url, self._body, self._asking)
            words, calls = self._take_chat(answer) if self._is_chat else self._take_messages(answer)
            if not calls:
                return
            results = [(call_id, await self._call(name, arguments)) for call_id, name, arguments in calls]
            done = [[name, at, text] for (_, name, at), (_, text) in zip(calls, results, strict=True)]
            self.turns.append([words, done])
            if self._is_chat:
                self._messages += [{"role": "tool", "tool_call_id": at, "content": text} for at, text in results]
            else:
                blocks = [{"type": "tool_result", "tool_use_id": at, "content": text} for at, text in results]
                self._messages.append({"role": "user", "content": blocks})

    def _take_chat(self, answer: Any) -> tuple[str, list[tuple[str, str, Any]]]:
        message = answer["choices"][0]["message"]
        self._messages.append(message)
        functions = [(call["id"], call["function"]) for call in message.get("tool_calls") or ()]
        calls = [(call_id, function["name"], json.loads(function["arguments"])) for call_id, function in functions]
        return message["content"], calls

    def _take_messages(self, answer: Any) -> tuple[str, list[tuple[str, str, Any]]]:
        self._messages.append({"role": "assistant", "content": answer["content"]})
        words = "".join(block["text"] for block in answer["content"] if block["type"] == "text")
        calls = [block for block in answer["content"] if block["type"] == "tool_use"]
        return words, [(block["id"], block["name"], block["input"]) for block in calls]

    async def _call(self, name: str, arguments: Any) -> str:
        self._made += 1
        own = f"{self.model} {self._made}"
        params = {"name": name, "arguments": arguments}
        asked = {"jsonrpc": "2.0", "id": own, "method": "tools/call", "params": params}
        answer = await self._post(self._mcp_url, asked, self._calling)
        if answer["id"] != own:
            raise SystemExit(f"The answer to the call {own} is that to {answer['id']}.")
        return str(answer["result"]["content"][0]["text"])

    async def _post(self, url: str, body: Any, times: list[float]) -> Any:
        begun = time.perf_counter()
        answer = (await self._http.post(url, json=body)).raise_for_status().json()
        times.append(time.perf_counter() - begun)
        return answer


if __name__ == "__main__":
    main()
