"""What a tool call costs through each adapter: ours alone, and the whole call beside a bare tool of the same framework.

    python benchmarks/adapters.py [--calls N] [--episodes N]

"Ours" is the time inside the handler: everything between the framework's call of our code and our answer. "Whole" is
what a caller waits for. "Bare" is a tool of the same framework that returns a constant. Medians, in microseconds.
"""

from __future__ import annotations

import argparse
import asyncio
import resource
import statistics
import sys
import time
from collections.abc import Awaitable, Callable
from typing import Any

import httpx2
import mcp_types as types
from agents import FunctionTool
from agents.tool_context import ToolContext
from langchain_core.tools import StructuredTool
from mcp import Client, StdioServerParameters, stdio_client
from mcp.client.streamable_http import streamable_http_client
from mcp.server.lowlevel import Server
from rich.console import Console
from rich.table import Table as RichTable
from smartplay_langchain import SmartPlayToolkit
from smartplay_mcp import Episodes, HttpServer, Table, game_server

import smartplay_tools as sp

GAME = "RockPaperScissorBasic-v0"
ACT = {"action": "Rock"}


def fresh() -> sp.Episode:
    """An episode that does not end while it is measured."""
    spec = sp.get_spec(GAME)
    long = type(spec)(**{**{name: getattr(spec, name) for name in spec.__dataclass_fields__}, "rollout": 10**9})
    return sp.Episode(long, seed=1, context="host", budget=sp.Budget(tool_calls=None))


def median(call: Callable[[], Any], calls: int) -> float:
    times = []
    for _ in range(calls):
        begun = time.perf_counter()
        call()
        times.append(time.perf_counter() - begun)
    return statistics.median(times) * 1e6


async def amedian(call: Callable[[], Awaitable[Any]], calls: int) -> float:
    times = []
    for _ in range(calls):
        begun = time.perf_counter()
        await call()
        times.append(time.perf_counter() - begun)
    return statistics.median(times) * 1e6


def langchain(calls: int) -> tuple[float, float, float]:
    """The toolkit's `act` beside a StructuredTool with the same schema."""
    act = SmartPlayToolkit(episode=fresh()).get_tools()[1]
    bare = StructuredTool(name="act", description="-", args_schema=act.args_schema, func=lambda **_: "constant")
    sent = {"type": "tool_call", "id": "c", "name": "act", "args": ACT}
    return (
        median(lambda: act._run(**ACT), calls),
        median(lambda: act.invoke(sent), calls),
        median(lambda: bare.invoke(sent), calls),
    )


async def agents_sdk(calls: int) -> tuple[float, float, float]:
    """A function tool's `on_invoke_tool`, which is what the runner calls."""
    episode = fresh()

    async def play(_: ToolContext[Any], arguments: str) -> str:
        return episode.call("act", arguments).text

    async def constant(_: ToolContext[Any], arguments: str) -> str:
        return "constant"

    schema = dict(episode.tools[1].parameters)
    ours, bare = (FunctionTool("act", "-", schema, function) for function in (play, constant))
    context = ToolContext(context=None, tool_name="act", tool_call_id="c", tool_arguments="{}")
    text = '{"action": "Rock"}'
    return (
        median(lambda: episode.call("act", text), calls),
        await amedian(lambda: ours.on_invoke_tool(context, text), calls),
        await amedian(lambda: bare.on_invoke_tool(context, text), calls),
    )


def bare_server() -> Server[Any]:
    """An MCP server with one tool that returns a constant."""

    async def call_tool(_: Any, __: Any) -> types.CallToolResult:
        return types.CallToolResult(content=[types.TextContent(type="text", text="constant")])

    async def list_tools(_: Any, __: Any) -> types.ListToolsResult:
        return types.ListToolsResult(tools=[types.Tool(name="act", input_schema={"type": "object"})])

    return Server("bare", on_call_tool=call_tool, on_list_tools=list_tools)


async def whole_call(transport: Any, calls: int) -> float:
    async with Client(transport) as client:
        await client.list_tools()
        return await amedian(lambda: client.call_tool("act", ACT), calls)


async def mcp_in_memory(calls: int) -> tuple[float, float, float]:
    table = Table(fresh())
    ours = await amedian(lambda: table.call("act", ACT), calls)
    whole = await whole_call(game_server(lambda _: table), calls)
    return ours, whole, await whole_call(bare_server(), calls)


async def mcp_stdio(calls: int) -> float:
    """A process of its own; 50 rounds a game, so there the observations are asked for."""
    arguments = ["-m", "smartplay_tools", "serve", "mcp", GAME, "--tool-calls", "none"]
    async with Client(stdio_client(StdioServerParameters(command=sys.executable, args=arguments))) as client:
        await client.list_tools()
        return await amedian(lambda: client.call_tool("observe"), calls)


async def mcp_http(server: HttpServer, handle: str, calls: int) -> list[float]:
    """Times of `observe` calls through one client, in seconds."""
    times = []
    async with (
        httpx2.AsyncClient(trust_env=False, timeout=300) as http,
        Client(streamable_http_client(f"{server.url}/mcp/{handle}", http_client=http)) as client,
    ):
        for _ in range(calls):
            begun = time.perf_counter()
            await client.call_tool("observe")
            times.append(time.perf_counter() - begun)
    return times


async def many(server: HttpServer, handles: list[str], calls: int) -> list[float]:
    """Every handle has a client of its own, all at once."""
    results = await asyncio.gather(*(mcp_http(server, handle, calls) for handle in handles))
    return [taken for times in results for taken in times]


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--calls", type=int, default=500)
    parser.add_argument("--episodes", type=int, default=1000)
    asked = parser.parse_args()
    table = RichTable("through", "ours", "whole", "bare", title="One tool call, median microseconds")
    episode = fresh()
    alone = median(lambda: episode.call("act", ACT), asked.calls)
    rows: list[tuple[str, float | None, float, float | None]] = [("Episode.call", alone, alone, None)]
    rows.append(("LangChain tool", *langchain(asked.calls)))
    rows.append(("Agents SDK tool", *asyncio.run(agents_sdk(asked.calls))))
    rows.append(("MCP in memory", *asyncio.run(mcp_in_memory(asked.calls))))
    rows.append(("MCP stdio", None, asyncio.run(mcp_stdio(asked.calls)), None))
    episodes = Episodes(most=asked.episodes)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    handles = [episodes.open(GAME, seed=seed) for seed in range(asked.episodes)]
    after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with HttpServer(episodes, port=0) as server:
        one = statistics.median(asyncio.run(mcp_http(server, handles[0], min(asked.calls, 200)))) * 1e6
        rows.append(("MCP HTTP", None, one, None))
        begun = time.perf_counter()
        times = sorted(asyncio.run(many(server, handles[1:], 3)))
        seconds = time.perf_counter() - begun
    for name, *figures in rows:
        table.add_row(name, *("" if figure is None else f"{figure:,.0f}" for figure in figures))
    console = Console()
    console.print(table)
    p50, p95 = (times[int(len(times) * share)] for share in (0.5, 0.95))
    console.print(
        f"{len(handles):,} episodes at once over HTTP: {len(times) / seconds:,.0f} calls/s, p50 {p50:.2f} s, "
        f"p95 {p95:.2f} s (clients in the same process); {(after - before) / len(handles):.0f} KiB an episode"
    )


if __name__ == "__main__":
    main()
