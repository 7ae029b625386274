"""What a start costs: importing the package, a command, and the first answer of a server on standard input.

    python benchmarks/startup.py

Every row is a process of its own, started several times with compiled modules at hand. `seconds` is the shortest time,
`processor` the least time that the processor worked for it, which other programs disturb less. The first row is the
floor, a Python that does nothing. Inspect AI and TextArena stand beside it where they are installed.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

from smartplay_tools.context.tokens.o200k import vocabulary

TIMES = 10
PEERS = {"inspect_ai": "inspect_ai", "textarena": "textarena"}
INITIALIZE = {"jsonrpc": "2.0", "id": 1, "method": "initialize", "params": {"protocolVersion": "2025-11-25"}}
LIST_TOOLS = {"jsonrpc": "2.0", "id": 2, "method": "tools/list"}
IMPORTS = "import sys, time, tiktoken.load; from smartplay_tools.context.tokens import o200k"
OURS = "made = o200k.o200k_base.__wrapped__()"
PUBLISHED = """
ranks = tiktoken.load.load_tiktoken_bpe(sys.argv[1], expected_hash=o200k.VOCABULARY_SHA256)
tiktoken.Encoding("o200k_base", pat_str=o200k.PATTERN, mergeable_ranks=ranks, special_tokens=o200k.SPECIAL)
"""
"""The same encoding with tiktoken's own reader of the published file, and without a download."""

TICKS = os.sysconf("SC_CLK_TCK")

Measured = tuple[float, float]
"""Seconds, and seconds of the processor."""


def whole(*command: str) -> Measured:
    """From the start of a process to its end."""
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run([sys.executable, *command], check=True, stdout=subprocess.DEVNULL)
    seconds, after = time.perf_counter() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
    return seconds, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def until_answered(*messages: dict) -> Measured:
    """From the start of the MCP server on standard input to its answer to the last of some messages."""
    command = [sys.executable, "-m", "smartplay_tools", "serve", "mcp", "Hanoi3Disk-v0"]
    begun = time.perf_counter()
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as server:
        assert server.stdin is not None
        assert server.stdout is not None
        for message in messages:
            server.stdin.write(json.dumps(message).encode() + b"\n")
            server.stdin.flush()
            server.stdout.readline()
        seconds, processor = time.perf_counter() - begun, processor_of(server.pid)
        server.stdin.close()
    return seconds, processor


def processor_of(pid: int) -> float:
    """What the processor has worked for a process that runs, where the system tells it."""
    try:
        with open(f"/proc/{pid}/stat", encoding="ascii") as file:  # noqa: PTH123 - not a file
            fields = file.read().rpartition(")")[2].split()
    except FileNotFoundError:
        return float("nan")
    return (int(fields[11]) + int(fields[12])) / TICKS


def within(code: str, *arguments: str) -> Measured:
    """The time of a part of a process, its imports left out."""
    clocks = "time.perf_counter(), time.process_time()"
    timed = f"{IMPORTS}\nbegan = {clocks}\n{code}\nprint(*(now - then for now, then in zip(({clocks}), began)))"
    completed = subprocess.run([sys.executable, "-c", timed, *arguments], check=True, stdout=subprocess.PIPE, text=True)
    seconds, processor = map(float, completed.stdout.split())
    return seconds, processor


def read_by_tiktoken() -> Measured:
    """The published file, read by tiktoken from this disk."""
    with tempfile.TemporaryDirectory() as folder:
        published = Path(folder, "o200k_base.tiktoken")
        published.write_bytes(vocabulary())
        os.environ["TIKTOKEN_CACHE_DIR"] = ""  # what is read is not also written to a cache
        return within(PUBLISHED, str(published))


def best(measure: Callable[[], Measured]) -> Measured:
    measure()  # compiles what is not compiled yet
    measurements = [measure() for _ in range(TIMES)]
    return min(seconds for seconds, _ in measurements), min(processor for _, processor in measurements)


def row(name: str, measured: Measured | None) -> None:
    figures = "not installed" if measured is None else "  ".join(f"{figure * 1000:8.0f} ms" for figure in measured)
    print(f"{name:<44} {figures}", flush=True)


def main() -> None:
    print(f"{'':<44} {'seconds':>11}  {'processor':>11}")
    row("python, nothing else", best(lambda: whole("-c", "pass")))
    row("import smartplay_tools", best(lambda: whole("-c", "import smartplay_tools")))
    row("  and Episode", best(lambda: whole("-c", "from smartplay_tools import Episode")))
    for name, module in PEERS.items():
        code = f"import {module}"
        row(f"import {name}", best(lambda code=code: whole("-c", code)) if find_spec(module) else None)
    row("smartplay-tools --help", best(lambda: whole("-m", "smartplay_tools", "--help")))
    row("smartplay-tools games", best(lambda: whole("-m", "smartplay_tools", "games")))
    row("the tokenizer's vocabulary", best(lambda: within(OURS)))
    row("  read by tiktoken, from the published file", best(read_by_tiktoken))
    row("MCP on stdio: until it says what it is", best(lambda: until_answered(INITIALIZE)))
    row("MCP on stdio: until its tools are listed", best(lambda: until_answered(INITIALIZE, LIST_TOOLS)))


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
        os.environ.setdefault("PYTHONPYCACHEPREFIX", folder)
        main()
