"""What a tool call costs through each adapter: ours alone, and the whole call beside a bare tool of the same framework.

    python benchmarks/adapters.py [--calls 500] [--turns 100]

"Ours" is the time inside our code: everything between the framework's call of it and its answer, the model left out.
"Whole" is what a caller waits for. "Bare" is the same with a tool that returns a constant. Medians, in microseconds.

An agent's turn is one model call and its one tool call. "Ours" then is all that an adapter with a window does for it:
budgets, view, conversion of the window's messages, answers, the record. It grows with the number of messages in the
window, and a framework's own share with the whole run, so a whole turn is the mean over `--turns` turns.

Servers on stdio and HTTP are processes of their own. `benchmarks/mcp_http.py` puts a thousand episodes on one.
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
from agents import Agent, FunctionTool, Model, ModelResponse, RunConfig, Runner, set_tracing_disabled
from agents.testing import assistant_message, function_call
from agents.usage import Usage
from langchain.agents import create_agent
from langchain.agents.middleware import hook_config
from langchain_core.language_models import BaseChatModel
from langchain_core.messages import AIMessage
from langchain_core.outputs import ChatGeneration, ChatResult
from langchain_core.tools import StructuredTool
from mcp import Client, StdioServerParameters, stdio_client
from mcp.client.streamable_http import streamable_http_client
from mcp.server.lowlevel import Server
from mcp.server.stdio import stdio_server
from rich.console import Console
from rich.table import Table as RichTable
from smartplay_langchain import SmartPlayMiddleware, SmartPlayToolkit
from smartplay_mcp import Table, game_server
from smartplay_openai.agents import SmartPlayModel

import smartplay_tools as sp

GAME = "RockPaperScissorBasic-v0"
ACT = {"action": "Rock"}
ACT_TEXT = '{"action": "Rock"}'
WINDOW = sp.Budget(prompt_tokens=4096, history=200, tool_calls=None)

Row = tuple[str, float | None, float, float | None]


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--calls", type=int, default=500)
    parser.add_argument("--turns", type=int, default=100)
    parser.add_argument("--bare", choices=["stdio", "http"], help="be the bare server")
    asked = parser.parse_args()
    if asked.bare:
        serve_bare(asked.bare)
        return
    set_tracing_disabled(True)
    calls = RichTable("one tool call through", "ours", "whole", "bare", title="Median microseconds")
    for row in tool_calls(asked.calls):
        add(calls, row)
    turns = RichTable("one turn of an agent", "ours", "whole", "bare", title="Microseconds a turn of one call")
    add(turns, ("LangChain, SmartPlayMiddleware", *langchain_agent(asked.turns)))
    add(turns, ("Agents SDK, SmartPlayModel", *asyncio.run(agents_sdk(asked.turns))))
    console = Console()
    console.print(calls)
    console.print(turns)


def add(table: RichTable, row: Row) -> None:
    name, *figures = row
    table.add_row(name, *("" if figure is None else f"{figure:,.0f}" for figure in figures))


# --- One call ------------------------------------------------------------------------------------------------------


def tool_calls(calls: int) -> Iterator[Row]:
    episode = fresh(context="host")
    alone = median(lambda: episode.call("act", ACT), calls)
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


def fresh(budget: sp.Budget = WINDOW, **options: Any) -> sp.Episode:
    """An episode that does not end while it is measured."""
    long = dataclasses.replace(sp.get_spec(GAME), rollout=10**9)
    if options.get("context") == "host":
        budget = sp.Budget(tool_calls=None)
    return sp.Episode(long, seed=1, budget=budget, **options)


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


def bare_tool() -> StructuredTool:
    schema = dict(fresh().tools[1].parameters)
    return StructuredTool(name="act", description="-", args_schema=schema, func=lambda **_: "constant")


def langchain_tool(calls: int) -> tuple[float, float, float]:
    act, constant = SmartPlayToolkit(episode=fresh(context="host")).get_tools()[1], bare_tool()
    sent = {"type": "tool_call", "id": "c", "name": "act", "args": ACT}
    ours = median(lambda: act._run(**ACT), calls)
    return ours, median(lambda: act.invoke(sent), calls), median(lambda: constant.invoke(sent), calls)


async def mcp_in_memory(calls: int) -> tuple[float, float, float]:
    table = Table(fresh(context="host"))
    ours = await amedian(lambda: table.call("act", ACT), calls)
    whole = await through_client(game_server(lambda _: table), calls, "act", ACT)
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


# --- One turn of an agent --------------------------------------------------------------------------------------------


class ActingModel(BaseChatModel):
    """Calls `act` so many times, then says so."""

    left: int

    @property
    def _llm_type(self) -> str:
        return "acting"

    def bind_tools(self, tools: Any, **kwargs: Any) -> Any:
        """It knows which tool it calls."""
        return self

    def _generate(self, messages: Any, stop: Any = None, run_manager: Any = None, **_: Any) -> ChatResult:
        self.left -= 1
        calls = [{"name": "act", "args": ACT, "id": f"c{self.left}", "type": "tool_call"}] if self.left >= 0 else []
        return ChatResult(generations=[ChatGeneration(message=AIMessage("", tool_calls=calls))])


class TimedMiddleware(SmartPlayMiddleware):
    """Knows what each turn took in its own hooks."""

    def __init__(self, episode: sp.Episode) -> None:
        super().__init__(episode)
        self.turns: list[float] = []

    @hook_config(can_jump_to=["end"])
    def before_model(self, state: Any, runtime: Any) -> Any:
        """Begin a turn."""
        begun = time.perf_counter()
        try:
            return super().before_model(state, runtime)
        finally:
            self.turns.append(time.perf_counter() - begun)

    def wrap_model_call(self, request: Any, handler: Any) -> Any:
        """Leave out what the model took."""
        begun, asked = time.perf_counter(), 0.0

        def timed(request: Any) -> Any:
            nonlocal asked
            sent = time.perf_counter()
            response = handler(request)
            asked = time.perf_counter() - sent
            return response

        response = super().wrap_model_call(request, timed)
        self.turns[-1] += time.perf_counter() - begun - asked
        return response

    @hook_config(can_jump_to=["model"])
    def after_model(self, state: Any, runtime: Any) -> Any:
        """Add what comes after the reply."""
        begun = time.perf_counter()
        result = super().after_model(state, runtime)
        self.turns[-1] += time.perf_counter() - begun
        return result


def langchain_agent(turns: int) -> tuple[float, float, float]:
    with fresh(WINDOW.model_copy(update={"tool_calls": turns})) as episode:
        middleware = TimedMiddleware(episode)
        agent = create_agent(ActingModel(left=turns), middleware=[middleware])
        whole = seconds(lambda: agent.invoke({"messages": []}))
    assert episode.result is not None
    assert episode.result.steps == turns
    alone = create_agent(ActingModel(left=turns), [bare_tool()])
    constant = seconds(lambda: alone.invoke({"messages": []}))
    return statistics.median(middleware.turns[:turns]) * 1e6, whole / turns * 1e6, constant / turns * 1e6


def seconds(call: Callable[[], Any]) -> float:
    begun = time.perf_counter()
    call()
    return time.perf_counter() - begun


class ActingAgentsModel(Model):
    """The same for the Agents SDK; knows what its replies took."""

    def __init__(self, turns: int) -> None:
        self.left, self.seconds = turns, 0.0

    async def get_response(self, *_: Any, **__: Any) -> ModelResponse:
        """Reply at once."""
        begun = time.perf_counter()
        self.left -= 1
        item = function_call("act", ACT_TEXT, call_id=f"c{self.left}") if self.left >= 0 else assistant_message("Done.")
        response = ModelResponse(output=[item], usage=Usage(), response_id=None)
        self.seconds = time.perf_counter() - begun
        return response

    def stream_response(self, *_: Any, **__: Any) -> Any:
        """Nobody asks for streams here."""
        raise NotImplementedError


class TimedModel(SmartPlayModel):
    """Knows what each turn took beside the model's reply."""

    def __init__(self, inner: ActingAgentsModel, episode: sp.Episode) -> None:
        super().__init__(inner, episode)
        self._inner, self.turns = inner, []

    async def get_response(self, *arguments: Any, **options: Any) -> ModelResponse:
        """Leave out what the model took."""
        begun = time.perf_counter()
        response = await super().get_response(*arguments, **options)
        self.turns.append(time.perf_counter() - begun - self._inner.seconds)
        return response


async def agents_sdk(turns: int) -> tuple[float, float, float]:
    async def run(model: Model, tools: list[Any], config: RunConfig | None = None) -> float:
        begun = time.perf_counter()
        await Runner.run(Agent("player", model=model, tools=tools), [], max_turns=None, run_config=config)
        return (time.perf_counter() - begun) / turns * 1e6

    async def constant(_: Any, __: str) -> str:
        return "constant"

    with fresh(WINDOW.model_copy(update={"tool_calls": turns})) as episode:
        model = TimedModel(ActingAgentsModel(turns), episode)
        whole = await run(model, model.tools, model.run_config)
    assert episode.result is not None
    assert episode.result.steps == turns
    tool = FunctionTool("act", "-", dict(fresh().tools[1].parameters), constant)
    return statistics.median(model.turns[:turns]) * 1e6, whole, await run(ActingAgentsModel(turns), [tool])


if __name__ == "__main__":
    main()
