"""The time of a tool call through each adapter, compared with a bare tool of the same framework.

    python benchmarks/adapters.py [--calls 500]

"Ours" is the time inside our code: everything between the framework's call of it and its answer, without the model.
"Whole" is the time of the whole call. "Bare" is the time of a call to a tool that returns a constant. Medians, in
microseconds.

Servers on stdio and HTTP are processes of their own. `benchmarks/agent_turns.py` measures whole agents with a window,
`benchmarks/mcp_http.py` puts a thousand episodes on one server.
"""

from __future__ import annotations

import argparse
import asyncio
import dataclasses
import socket
import statistics
import subprocess
import sys
import time
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from typing import Any

import httpx2
import mcp_types as types
import uvicorn
from core import microseconds
from langchain_core.tools import StructuredTool
from mcp import Client, StdioServerParameters, stdio_client
from mcp.client.streamable_http import streamable_http_client
from mcp.server.lowlevel import Server
from mcp.server.stdio import stdio_server
from rich.console import Console
from rich.table import Table as RichTable
from smartplay_langchain import SmartPlayToolkit
from smartplay_mcp import game_server

import smartplay_tools as sp
from smartplay_tools.games import get_spec
from smartplay_tools.web import HostedEpisode

GAME = "RockPaperScissorBasic-v0"
ACT = {"action": "Rock"}

Row = tuple[str, float | None, float, float | None]


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--calls", type=int, default=500)
    parser.add_argument("--bare", choices=["stdio", "http"], help="be the bare server")
    asked = parser.parse_args()
    if asked.bare:
        serve_bare(asked.bare)
        return
    table = RichTable("one tool call through", "ours", "whole", "bare", title="Median microseconds")
    for name, *figures in tool_calls(asked.calls):
        table.add_row(name, *("" if figure is None else f"{figure:,.0f}" for figure in figures))
    Console().print(table)


def tool_calls(calls: int) -> Iterator[Row]:
    episode = fresh()
    alone = microseconds(lambda: episode.call("act", ACT), calls)
    yield "Episode.call", alone, alone, None
    yield "LangChain tool", *langchain_tool(calls)
    in_memory = asyncio.run(mcp_in_memory(calls))
    yield "MCP in memory", *in_memory
    # The handler is the same one in another process, so its share is, too.
    ours, *_ = in_memory
    yield (
        "MCP on stdio",
        ours,
        asyncio.run(on_stdio(play_command(), calls)),
        asyncio.run(on_stdio(bare("stdio"), calls)),
    )
    with (
        served(["-m", *play_command(), "--http", "--port", "0"]) as url,
        served(bare("http")) as bare_url,
    ):
        yield "MCP over HTTP", ours, asyncio.run(over_http(url, calls)), asyncio.run(over_http(bare_url, calls))


def fresh() -> sp.Episode:
    """An episode that does not end while it is measured."""
    long = dataclasses.replace(get_spec(GAME), rollout=10**9)
    return sp.Episode(long, seed=1, context="host", budget=sp.Budget(tool_calls=None))


async def amedian(call: Callable[[], Awaitable[Any]], calls: int) -> float:
    times = []
    for _ in range(calls):
        begun = time.perf_counter()
        await call()
        times.append(time.perf_counter() - begun)
    return statistics.median(times) * 1e6


def langchain_tool(calls: int) -> tuple[float, float, float]:
    act = SmartPlayToolkit(episode=fresh()).get_tools()[1]
    constant = StructuredTool(name="act", description="-", args_schema=act.args_schema, func=lambda **_: "constant")
    sent = {"type": "tool_call", "id": "c", "name": "act", "args": ACT}
    ours = microseconds(lambda: act._run(**ACT), calls)
    return ours, microseconds(lambda: act.invoke(sent), calls), microseconds(lambda: constant.invoke(sent), calls)


async def mcp_in_memory(calls: int) -> tuple[float, float, float]:
    hosted = HostedEpisode(fresh())
    ours = await amedian(lambda: hosted.call("act", ACT), calls)
    whole = await through_client(game_server(lambda _: hosted), calls, "act", ACT)
    return ours, whole, await through_client(bare_server(), calls, "act", ACT)


async def through_client(transport: Any, calls: int, tool: str, arguments: dict[str, str] | None = None) -> float:
    async with Client(transport) as client:
        await client.list_tools()
        return await amedian(lambda: client.call_tool(tool, arguments), calls)


def play_command() -> list[str]:
    # A game has 50 rounds here, so it is `observe` that is called.
    return ["smartplay_tools", "serve", "mcp", GAME, "--tool-calls", "none"]


def bare(kind: str) -> list[str]:
    return [__file__, "--bare", kind]


async def on_stdio(command: list[str], calls: int) -> float:
    arguments = command if command[0] == __file__ else ["-m", *command]
    server = stdio_client(StdioServerParameters(command=sys.executable, args=arguments))
    return await through_client(server, calls, "observe")


async def over_http(url: str, calls: int) -> float:
    async with httpx2.AsyncClient(trust_env=False) as http:
        return await through_client(streamable_http_client(url, http_client=http), calls, "observe")


@contextmanager
def served(command: list[str]) -> Iterator[str]:
    """Start a server that prints where it is."""
    process = subprocess.Popen([sys.executable, *command], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        yield process.stdout.readline().split()[0]
    finally:
        process.terminate()
        process.wait()


def bare_server() -> Server[Any]:
    """An MCP server whose tools return a constant."""

    async def call_tool(_: Any, __: Any) -> types.CallToolResult:
        return types.CallToolResult(content=[types.TextContent(type="text", text="constant")])

    async def list_tools(_: Any, __: Any) -> types.ListToolsResult:
        tools = [types.Tool(name=name, input_schema={"type": "object"}) for name in ("act", "observe")]
        return types.ListToolsResult(tools=tools)

    return Server("bare", on_call_tool=call_tool, on_list_tools=list_tools)


def serve_bare(kind: str) -> None:
    server = bare_server()
    if kind == "http":
        app = server.streamable_http_app(json_response=True, stateless_http=True)
        # As in `HttpServer`: on a socket whose protocol is not named, small answers may wait for 40 ms.
        listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP)
        listening.bind(("127.0.0.1", 0))
        listening.listen()
        print(f"http://127.0.0.1:{listening.getsockname()[1]}/mcp", flush=True)
        uvicorn.Server(uvicorn.Config(app, log_level="warning", ws="none")).run([listening])
        return

    async def run() -> None:
        async with stdio_server() as (reading, writing):
            await server.run(reading, writing, server.create_initialization_options())

    asyncio.run(run())


if __name__ == "__main__":
    main()
