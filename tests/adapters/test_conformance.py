"""The conversation of `conformance.py` through every adapter. A new adapter is one more row."""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import AsyncIterator, Callable, Iterable, Sequence
from contextlib import AsyncExitStack, ExitStack, asynccontextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import httpx2
import pytest
from agents import Agent, FunctionTool, ModelSettings, Runner, function_tool, set_tracing_disabled
from langchain.agents import create_agent
from langchain_core.messages import AIMessage, ToolMessage
from langchain_core.tools import StructuredTool
from langgraph.graph import START, MessagesState, StateGraph
from langgraph.prebuilt import ToolNode
from mcp import Client, StdioServerParameters, stdio_client
from mcp.client.streamable_http import streamable_http_client
from smartplay_anthropic import AnthropicPlayer
from smartplay_langchain import GraphSession, LangChainPlayer, SmartPlayMiddleware, SmartPlayToolkit
from smartplay_mcp import HttpServer, game_server
from smartplay_openai import OpenAIPlayer, ResponsesPlayer, WindowEndpoint
from smartplay_openai.agents import SmartPlayModel

import smartplay_tools as sp
from smartplay_tools.players import ModelPlayer
from smartplay_tools.web import EpisodeStore, HostedEpisode
from tests.adapters import conformance
from tests.adapters.anthropic_stub import AnthropicStub
from tests.adapters.conformance import (
    BASIC,
    BROKEN,
    BUDGETS,
    GAME,
    HOST_BUDGET,
    IDLE,
    WEATHER,
    Host,
    Send,
    Sent,
    Turns,
    Window,
    calling,
    host_episode,
    line_of,
    table,
)
from tests.adapters.openai_stub import OpenAIStub
from tests.adapters.scripted_agents import ReadingModel
from tests.adapters.scripted_langchain import ScriptedModel
from tests.adapters.window_host import INTERFACES, TOOLS, HostAgent, client_of

Script = Iterable[sp.Message]


@pytest.fixture(autouse=True)
def _no_traces() -> None:
    """No traces to a provider."""
    set_tracing_disabled(True)


# --- Adapters that manage the context ----------------------------------------------------------------------------


def weather(city: str = "") -> str:
    """Tell the weather."""
    raise AssertionError("its arguments are not JSON")


def of_langchain() -> StructuredTool:
    return StructuredTool(
        name=WEATHER.name, description=WEATHER.description, args_schema=dict(WEATHER.parameters), func=weather
    )


def of_agents_sdk() -> FunctionTool:
    tool = function_tool(weather, name_override=WEATHER.name, strict_mode=False)
    return replace(tool, description=WEATHER.description, params_json_schema=dict(WEATHER.parameters))


def langchain_agent(episode: sp.Episode, script: Script, *, own_cap: int | None = None, own_tool: bool = False) -> Sent:
    model = ScriptedModel(script, own_cap)
    create_agent(model, [of_langchain()] * own_tool, middleware=[SmartPlayMiddleware(episode)]).invoke({"messages": []})
    return model.received


def langchain_agent_async(
    episode: sp.Episode, script: Script, *, own_cap: int | None = None, own_tool: bool = False
) -> Sent:
    model = ScriptedModel(script, own_cap)
    agent = create_agent(model, [of_langchain()] * own_tool, middleware=[SmartPlayMiddleware(episode)])
    asyncio.run(agent.ainvoke({"messages": []}))
    return model.received


def langgraph(episode: sp.Episode, script: Script, *, own_cap: int | None = None) -> Sent:
    session, model = GraphSession(episode), ScriptedModel(script, own_cap)

    def after_speaking(state: MessagesState) -> str:
        if episode.done:
            return "__end__"
        return "tools" if getattr(state["messages"][-1], "tool_calls", ()) else "speak"

    graph = StateGraph(MessagesState)
    graph.add_node("speak", lambda state: {"messages": session.ask(model, state["messages"])})
    graph.add_node("tools", ToolNode(session.tools, wrap_tool_call=session.wrap_tool_call))
    graph.add_edge(START, "speak")
    graph.add_conditional_edges("speak", after_speaking)
    graph.add_edge("tools", "speak")
    graph.compile().invoke({"messages": []}, {"recursion_limit": 100})
    return model.received


def agents_sdk(
    episode: sp.Episode,
    script: Script,
    *,
    own_cap: int | None = None,
    streamed: bool = False,
    own_tool: bool = False,
) -> Sent:
    inner = ReadingModel(script)
    model = SmartPlayModel(inner, episode)
    tools = [*model.tools, *[of_agents_sdk()] * own_tool]
    agent = Agent("player", model=model, tools=tools, model_settings=ModelSettings(max_tokens=own_cap))

    async def run() -> None:
        if streamed:
            running = Runner.run_streamed(agent, [], max_turns=None, run_config=model.run_config)
            async for _ in running.stream_events():
                pass
        else:
            await Runner.run(agent, [], max_turns=None, run_config=model.run_config)

    asyncio.run(run())
    return inner.received


def langchain_player(episode: sp.Episode, script: Script, *, play: Play, own_cap: int | None = None) -> Sent:
    model = ScriptedModel(script, own_cap)
    play(episode, LangChainPlayer(model))
    return model.received


def anthropic_player(episode: sp.Episode, script: Script, *, play: Play, own_cap: int | None = None) -> Sent:
    with AnthropicStub(script) as stub:
        own = {} if own_cap is None else {"max_tokens": own_cap}
        play(episode, AnthropicPlayer("m", base_url=stub.url, retries=0, parameters=own))
    return stub.received


def openai_player(
    episode: sp.Episode,
    script: Script,
    *,
    play: Play,
    own_cap: int | None = None,
    kind: type[OpenAIPlayer] = OpenAIPlayer,
    cap_field: str = "max_tokens",
) -> Sent:
    with OpenAIStub(script) as stub:
        own = {} if own_cap is None else {cap_field: own_cap}
        play(episode, kind("m", base_url=stub.base_url, retries=0, parameters=own))
    return stub.received


def window_endpoint(
    episode: sp.Episode, script: Script, *, interface: str, own_cap: int | None = None, own_tool: bool = False
) -> Sent:
    """A host's agent plays at the endpoint; the model behind it is one of OpenAI's, which sees the window."""
    own = {} if own_cap is None else {"max_tokens": own_cap}
    with (
        OpenAIStub(script) as stub,
        OpenAIPlayer("m", base_url=stub.base_url, retries=0, parameters=own) as player,
        WindowEndpoint(player) as endpoint,
    ):
        handle = endpoint.serve(episode)
        agent = HostAgent(endpoint, handle)
        offered = [*TOOLS, *[sp.schema(WEATHER, "openai")] * own_tool]
        if interface == "mcp":
            agent.tools = offered
            agent.play()
        else:
            tools = {name: partial(agent.run_named, name) for name in ("observe", "act", "read_manual")}
            with client_of(interface, endpoint) as client:
                INTERFACES[interface](client, endpoint.model(handle), tools, stream=True, offered=offered)
    return stub.received


Play = Callable[[sp.Episode, ModelPlayer], None]


def waiting(episode: sp.Episode, player: ModelPlayer) -> None:
    with player:
        sp.play(episode, player)


def on_a_loop(episode: sp.Episode, player: ModelPlayer) -> None:
    async def play() -> None:
        async with player:
            await sp.aplay(episode, player)

    asyncio.run(play())


responses_player = partial(openai_player, kind=ResponsesPlayer, cap_field="max_output_tokens")

AGENTS = "Agents SDK `SmartPlayModel`"
ANTHROPIC = "Anthropic player"
LANGCHAIN = "LangChain `SmartPlayMiddleware`"
OPENAI = "OpenAI players"
WINDOW_ENDPOINT = "Window endpoint"
PLAY = "`play`, `aplay`"

WINDOW = {
    "AgentSession": Window(conformance.by_session, "`AgentSession`"),
    "Agents SDK": Window(agents_sdk, AGENTS, has_tools=True),
    "Agents SDK, streamed": Window(partial(agents_sdk, streamed=True), AGENTS, has_tools=True),
    "Anthropic player": Window(partial(anthropic_player, play=waiting), ANTHROPIC, broken_json=False),
    "Anthropic player, async": Window(partial(anthropic_player, play=on_a_loop), ANTHROPIC, broken_json=False),
    "Conversation": Window(conformance.by_conversation, "`Conversation`"),
    "LangChain agent": Window(langchain_agent, LANGCHAIN, has_tools=True),
    "LangChain agent, async": Window(langchain_agent_async, LANGCHAIN, has_tools=True),
    "LangChain player": Window(partial(langchain_player, play=waiting), PLAY),
    "LangChain player, async": Window(partial(langchain_player, play=on_a_loop), PLAY),
    "LangGraph": Window(langgraph, LANGCHAIN),
    "Window endpoint, tools over MCP": Window(
        partial(window_endpoint, interface="mcp"), WINDOW_ENDPOINT, has_tools=True
    ),
    "Window endpoint, chat completions": Window(
        partial(window_endpoint, interface="chat"), WINDOW_ENDPOINT, has_tools=True
    ),
    "Window endpoint, Messages": Window(
        partial(window_endpoint, interface="messages"), WINDOW_ENDPOINT, has_tools=True
    ),
    "Window endpoint, Responses": Window(
        partial(window_endpoint, interface="responses"), WINDOW_ENDPOINT, has_tools=True
    ),
    "OpenAI player": Window(partial(openai_player, play=waiting), OPENAI),
    "OpenAI player, async": Window(partial(openai_player, play=on_a_loop), OPENAI),
    "OpenAI Responses player": Window(partial(responses_player, play=waiting), OPENAI),
    "OpenAI Responses player, async": Window(partial(responses_player, play=on_a_loop), OPENAI),
}


# Behind an endpoint there are two servers, so the conformance of the window endpoint is slow to test.
def rows(names: Iterable[str]) -> list[Any]:
    slow = pytest.mark.slow
    return [pytest.param(row, marks=slow) if WINDOW[row].through == WINDOW_ENDPOINT else row for row in names]


ROWS = rows(WINDOW)


@pytest.mark.parametrize("budget", ["tight", "lazy"])
def test_these_budgets_make_turns_leave_the_window(budget):
    episode, events = conformance.fresh(BUDGETS[budget])
    with episode:
        conformance.by_conversation(episode, BASIC)
    shown = [sum(last - first + 1 for first, last in e["turns"]) for e in events if e["event"] == "view"]
    assert max(turn - turns for turn, turns in enumerate(shown)) >= 4


@pytest.mark.parametrize("budget", BUDGETS)
@pytest.mark.parametrize("row", ROWS)
def test_the_game_cannot_tell_adapters_apart(row, budget):
    result = conformance.judge(WINDOW[row], BASIC, BUDGETS[budget])
    assert result.end_reason == ("prompt_tokens" if budget == "spent" else "terminated")
    assert result.refused_calls == (budget != "spent"), "the last act comes after the end"


@pytest.mark.parametrize("row", ROWS)
def test_the_tools_of_memory(row):
    conformance.judge_memory(WINDOW[row])


@pytest.mark.parametrize("row", ROWS)
def test_words_without_a_call(row):
    conformance.judge(WINDOW[row], IDLE, BUDGETS["tight"])


@pytest.mark.parametrize("row", [row for row in WINDOW if WINDOW[row].broken_json])
def test_arguments_that_are_no_json(row):
    conformance.judge(WINDOW[row], BROKEN, BUDGETS["tight"])


@pytest.mark.parametrize("row", rows(row for row in WINDOW if WINDOW[row].has_tools))
def test_a_broken_call_of_a_tool_of_the_agents_own(row):
    conformance.judge_broken_foreign_call(WINDOW[row])


@pytest.mark.parametrize("row", ROWS)
def test_prompts_for_a_summary_are_answered_in_between(row):
    conformance.judge_summaries(WINDOW[row])


@pytest.mark.parametrize("row", ROWS)
def test_the_smaller_of_two_caps_on_replies_applies(row):
    conformance.judge_caps(WINDOW[row])


@pytest.mark.parametrize("row", ROWS)
def test_two_episodes_interleaved(row):
    """Each episode has its own thread; their replies alternate."""

    async def both() -> None:
        mine = Turns()
        others = mine.other_side()
        one = asyncio.to_thread(conformance.judge, WINDOW[row], BASIC, BUDGETS["tight"], mine)
        other = asyncio.to_thread(conformance.judge, WINDOW[row], IDLE, BUDGETS["free"], others)
        await asyncio.gather(one, other)
        assert min(mine.taken_in_turn, others.taken_in_turn) == len(BASIC)

    asyncio.run(both())


# --- Adapters whose host manages the context ---------------------------------------------------------------------

Opened = AsyncIterator[list[Send]]


@asynccontextmanager
async def direct(seeds: Sequence[int], folder: Path, send_to: Callable[[sp.Episode], Send]) -> Opened:
    """Episodes in this process."""
    with ExitStack() as stack:
        yield [send_to(stack.enter_context(host_episode(seed, folder))) for seed in seeds]


def through_episode(episode: sp.Episode) -> Send:
    async def send(name: str, arguments: Any) -> tuple[str, bool]:
        result = await episode.acall(name, arguments)
        return result.text, result.is_error

    return send


def through_functions(episode: sp.Episode) -> Send:
    functions = {function.__name__: function for function in episode.functions()}

    async def send(name: str, arguments: Any) -> tuple[str, None]:
        return functions[name](**arguments), None

    return send


def through_toolkit(episode: sp.Episode, *, asynchronously: bool = False) -> Send:
    tools = {tool.name: tool for tool in SmartPlayToolkit(episode=episode).get_tools()}

    async def send(name: str, arguments: Any) -> tuple[str, bool]:
        call = {"type": "tool_call", "id": "c0", "name": name, "args": arguments}
        message = await tools[name].ainvoke(call) if asynchronously else tools[name].invoke(call)
        return message.content, message.status == "error"

    return send


def through_toolkit_in_an_agent(episode: sp.Episode) -> Send:
    tools = SmartPlayToolkit(episode=episode).get_tools()

    async def send(name: str, arguments: Any) -> tuple[str, bool]:
        model = ScriptedModel([calling((name, arguments)), calling(say="I have seen it.")])
        state = await create_agent(model, tools).ainvoke({"messages": []})
        (message,) = [message for message in state["messages"] if isinstance(message, ToolMessage)]
        return message.content, message.status == "error"

    return send


def through_client(client: Client) -> Send:
    async def send(name: str, arguments: Any) -> tuple[str, bool]:
        result = await client.call_tool(name, arguments)
        return result.content[0].text, result.is_error

    return send


@asynccontextmanager
async def mcp_in_memory(seeds: Sequence[int], folder: Path, mode: str) -> Opened:
    async with AsyncExitStack() as stack:
        tables = [HostedEpisode(stack.enter_context(host_episode(seed, folder))) for seed in seeds]
        servers = [game_server(lambda _, table=table: table) for table in tables]
        yield [through_client(await stack.enter_async_context(Client(server, mode=mode))) for server in servers]


@asynccontextmanager
async def mcp_on_stdio(seeds: Sequence[int], folder: Path, mode: str) -> Opened:
    """A process for each episode, as a host would start it."""
    async with AsyncExitStack() as stack:
        senders = []
        for seed in seeds:
            options = ["--seed", str(seed), "--history", str(HOST_BUDGET.history)]
            options += ["--transcript", str(folder / f"{seed}.jsonl")]
            command = ["-m", "smartplay_tools", "serve", "mcp", GAME, *options]
            server = StdioServerParameters(command=sys.executable, args=command, env=dict(os.environ))
            transport = stdio_client(server)
            senders.append(through_client(await stack.enter_async_context(Client(transport, mode=mode))))
        yield senders


@asynccontextmanager
async def mcp_over_http(seeds: Sequence[int], folder: Path, mode: str) -> Opened:
    """One server for all episodes."""
    episodes = EpisodeStore(folder=folder)
    handles = [episodes.open(GAME, seed=seed, budget=HOST_BUDGET) for seed in seeds]
    async with AsyncExitStack() as stack:
        server = stack.enter_context(HttpServer(episodes, port=0))
        http = await stack.enter_async_context(httpx2.AsyncClient(trust_env=False))
        addresses = [f"{server.url}/mcp/{handle}" for handle in handles]
        clients = [Client(streamable_http_client(address, http_client=http), mode=mode) for address in addresses]
        yield [through_client(await stack.enter_async_context(client)) for client in clients]
    for handle in handles:
        episodes.close(handle)


def a_tool_that_there_is(name: str, arguments: Any) -> bool:
    return name in ("observe", "act", "read_manual")


def a_call_that_python_can_make(name: str, arguments: Any) -> bool:
    return a_tool_that_there_is(name, arguments) and list(arguments) == (["action"] if name == "act" else [])


FUNCTIONS = "`Episode.functions()`"
MCP = "MCP"
TOOLKIT = "LangChain `SmartPlayToolkit` alone"

HOST = {
    "Episode": Host(partial(direct, send_to=through_episode), "`Episode.call`"),
    "Functions": Host(partial(direct, send_to=through_functions), FUNCTIONS, a_call_that_python_can_make),
    "LangChain toolkit": Host(partial(direct, send_to=through_toolkit), TOOLKIT, a_tool_that_there_is),
    "LangChain toolkit, async": Host(
        partial(direct, send_to=partial(through_toolkit, asynchronously=True)), TOOLKIT, a_tool_that_there_is
    ),
    "LangChain toolkit in an agent": Host(
        partial(direct, send_to=through_toolkit_in_an_agent), TOOLKIT, a_tool_that_there_is
    ),
    "MCP in memory": Host(partial(mcp_in_memory, mode="auto"), MCP),
    "MCP in memory, legacy": Host(partial(mcp_in_memory, mode="legacy"), MCP),
    "MCP on stdio": Host(partial(mcp_on_stdio, mode="auto"), MCP),
    "MCP on stdio, legacy": Host(partial(mcp_on_stdio, mode="legacy"), MCP),
    "MCP over HTTP": Host(partial(mcp_over_http, mode="auto"), MCP),
    "MCP over HTTP, legacy": Host(partial(mcp_over_http, mode="legacy"), MCP),
}


@pytest.mark.parametrize("row", HOST)
async def test_the_game_cannot_tell_hosts_apart(row, tmp_path):
    await conformance.judge_hosts(HOST[row], tmp_path)


# --- What is enforced where: the table in the documentation -------------------------------------------------------


ELSEWHERE = {
    "Inspect AI `smartplay_agent`": "test_inspect.py",
    "OpenEnv `SmartPlayEnvironment`": "test_openenv.py",
    "OpenEnv `SmartPlayHarness`": "test_openenv.py",
    "Pydantic AI `SmartPlay`": "test_pydantic_ai.py",
    "TRL `environment`": "test_trl.py",
    "verifiers `SmartPlayHarness`": "test_verifiers.py",
}
"""The lines of frameworks that have environments of their own, and the files with their rows."""


def test_every_line_of_the_table_has_a_row():
    here = {line_of(row)["through"] for row in (*WINDOW.values(), *HOST.values())}
    assert here | ELSEWHERE.keys() == table().keys()
    assert all(line["repaired or refused by the host"] for line in table().values())
    for line, file in ELSEWHERE.items():
        assert line in Path(__file__).with_name(file).read_text(encoding="utf-8")


@pytest.mark.parametrize("row", ROWS)
def test_the_table_says_what_the_rows_show(row):
    conformance.check_line(WINDOW[row])


@pytest.mark.parametrize("row", HOST)
def test_the_table_says_what_the_rows_show_of_hosts(row):
    line = line_of(HOST[row])
    assert (line["context"], line["window and token budgets"]) == ("the host's", "not enforced")
    assert (line["unknown tool"] == "answered") == HOST[row].carries("jump", {"how": "high"})


@pytest.mark.parametrize("broken", [{"name": "act", "arguments": "{"}, {"name": "act", "arguments": [1]}], ids=repr)
def test_mcp_refuses_arguments_that_are_no_object(broken):
    episodes = EpisodeStore()
    table = episodes.find(episodes.open(GAME, seed=1))
    call = {"jsonrpc": "2.0", "id": 1, "method": "tools/call", "params": broken}
    with HttpServer(episodes, port=0) as server:
        (handle,) = episodes._hosted
        headers = {"Accept": "application/json, text/event-stream"}
        answer = httpx2.post(f"{server.url}/mcp/{handle}", json=call, headers=headers, trust_env=False).json()
    assert "error" in answer
    assert table.episode.stats.tool_calls == 0


def test_what_never_reaches_a_plain_toolkit(tmp_path):
    """Why a toolkit alone is not a measurement: LangChain answers an unknown tool, and stops at broken JSON."""
    with host_episode(7, tmp_path) as episode:
        tools = SmartPlayToolkit(episode=episode).get_tools()
        unknown = ScriptedModel([calling(("jump", {})), calling(say="Well.")])
        state = create_agent(unknown, tools).invoke({"messages": []})
        assert "not a valid tool" in state["messages"][1].content
        broken = create_agent(ScriptedModel([calling(("act", "{"))]), tools).invoke({"messages": []})
        (reply,) = broken["messages"]
        assert isinstance(reply, AIMessage)
    assert episode.result.tool_calls == 0
