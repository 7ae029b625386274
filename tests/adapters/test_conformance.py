"""The conversation of `conformance.py` through every adapter. A new adapter is one more row."""

from __future__ import annotations

import asyncio
from functools import partial
from typing import Any

import pytest
from agents import Agent, Runner, set_tracing_disabled
from agents import testing as agents_testing
from langchain.agents import create_agent
from langchain_core.tools import BaseTool
from langgraph.graph import START, MessagesState, StateGraph
from mcp import Client
from smartplay_anthropic import AnthropicPlayer
from smartplay_langchain import LangChainPlayer, Seat, SmartPlayMiddleware, SmartPlayToolkit
from smartplay_mcp import Table, game_server
from smartplay_openai.agents import SmartPlayModel

import smartplay_tools as sp
from tests.adapters import conformance, scripted_agents
from tests.adapters.anthropic_stub import AnthropicStub
from tests.adapters.conformance import BASIC, BROKEN, BUDGETS, IDLE, Script, Sent
from tests.adapters.scripted_langchain import ScriptedModel


@pytest.fixture(autouse=True)
def _no_network(monkeypatch: pytest.MonkeyPatch) -> None:
    """No traces to a provider, and no proxy between a client and the stub beside it."""
    set_tracing_disabled(True)
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")


# --- Adapters that own the context -------------------------------------------------------------------------------


def langchain_agent(episode: sp.Episode, script: Script) -> Sent:
    model = ScriptedModel(script)
    create_agent(model, middleware=[SmartPlayMiddleware(episode)]).invoke({"messages": []})
    return model.sent


def langchain_agent_async(episode: sp.Episode, script: Script) -> Sent:
    model = ScriptedModel(script)
    asyncio.run(create_agent(model, middleware=[SmartPlayMiddleware(episode)]).ainvoke({"messages": []}))
    return model.sent


def langchain_player(episode: sp.Episode, script: Script) -> Sent:
    model = ScriptedModel(script)
    sp.play(episode, LangChainPlayer(model))
    return model.sent


def langchain_player_async(episode: sp.Episode, script: Script) -> Sent:
    model = ScriptedModel(script)
    asyncio.run(sp.aplay(episode, LangChainPlayer(model)))
    return model.sent


def langgraph(episode: sp.Episode, script: Script) -> Sent:
    seat, model = Seat(episode), ScriptedModel(script)

    def speak(state: MessagesState) -> dict[str, Any]:
        view = seat.view(state["messages"])
        return {"messages": [] if view is None else seat.receive(model.invoke(view))}

    graph = StateGraph(MessagesState)
    graph.add_node("speak", speak)
    graph.add_edge(START, "speak")
    graph.add_conditional_edges("speak", lambda _: "__end__" if episode.done else "speak")
    graph.compile().invoke({"messages": []}, {"recursion_limit": 100})
    return model.sent


def agents_sdk(episode: sp.Episode, script: Script, *, streamed: bool = False) -> Sent:
    inner = agents_testing.ScriptedModel([scripted_agents.step(message) for message in script])
    model = SmartPlayModel(inner, episode)
    agent = Agent("player", model=model, tools=model.tools)

    async def run() -> None:
        if streamed:
            running = Runner.run_streamed(agent, [], max_turns=None, run_config=model.run_config)
            async for _ in running.stream_events():
                pass
        else:
            await Runner.run(agent, [], max_turns=None, run_config=model.run_config)

    asyncio.run(run())
    return [scripted_agents.read(call.input) for call in inner.calls]


def anthropic_player(episode: sp.Episode, script: Script) -> Sent:
    with AnthropicStub(script) as stub, AnthropicPlayer("m", base_url=stub.url, api_key="k") as player:
        sp.play(episode, player)
    return stub.sent


def anthropic_player_async(episode: sp.Episode, script: Script) -> Sent:
    async def play(url: str) -> None:
        player = AnthropicPlayer("m", base_url=url, api_key="k")
        await sp.aplay(episode, player)
        await player.aclose()

    with AnthropicStub(script) as stub:
        asyncio.run(play(stub.url))
    return stub.sent


WINDOW = {
    "Agents SDK": agents_sdk,
    "Agents SDK, streamed": partial(agents_sdk, streamed=True),
    "Anthropic player": anthropic_player,
    "Anthropic player, async": anthropic_player_async,
    "Conversation": conformance.by_conversation_with_one_system,
    "LangChain agent": langchain_agent,
    "LangChain agent, async": langchain_agent_async,
    "LangChain player": langchain_player,
    "LangChain player, async": langchain_player_async,
    "LangGraph": langgraph,
}
BROKEN_ARGUMENTS = [
    "Agents SDK",
    "Conversation",
    "LangChain agent",
    "LangChain agent, async",
    "LangChain player",
    "LangGraph",
]
"""Adapters whose wire can carry arguments that are no JSON."""


@pytest.mark.parametrize("budget", BUDGETS)
@pytest.mark.parametrize("row", WINDOW)
def test_the_game_cannot_tell_adapters_apart(row, budget):
    conformance.judge(WINDOW[row], BASIC, BUDGETS[budget])


@pytest.mark.parametrize("row", WINDOW)
def test_words_without_a_call(row):
    conformance.judge(WINDOW[row], IDLE, BUDGETS["tight"])


@pytest.mark.parametrize("row", BROKEN_ARGUMENTS)
def test_arguments_that_are_no_json(row):
    conformance.judge(WINDOW[row], BROKEN, BUDGETS["tight"])


@pytest.mark.parametrize("row", WINDOW)
def test_two_episodes_at_once(row):
    """Each in a thread of its own, with steps that interleave as they please."""

    async def both() -> None:
        hold = WINDOW[row]
        one = asyncio.to_thread(conformance.judge, hold, BASIC, BUDGETS["tight"])
        other = asyncio.to_thread(conformance.judge, hold, IDLE, BUDGETS["free"])
        await asyncio.gather(one, other)

    asyncio.run(both())


# --- Adapters whose host owns the context ------------------------------------------------------------------------


def by_name(episode: sp.Episode) -> dict[str, BaseTool]:
    return {tool.name: tool for tool in SmartPlayToolkit(episode=episode).get_tools()}


def raw_episode(episode: sp.Episode, calls: list[tuple[str, Any]]) -> list[tuple[str, bool]]:
    results = [episode.call(name, arguments) for name, arguments in calls]
    return [(result.text, result.is_error) for result in results]


def raw_episode_async(episode: sp.Episode, calls: list[tuple[str, Any]]) -> list[tuple[str, bool]]:
    async def send() -> list[tuple[str, bool]]:
        results = [await episode.acall(name, arguments) for name, arguments in calls]
        return [(result.text, result.is_error) for result in results]

    return asyncio.run(send())


def toolkit(episode: sp.Episode, calls: list[tuple[str, Any]]) -> list[tuple[str, bool]]:
    """A toolkit has no tool that is not there, so that call goes to the episode, as a framework's error would not."""
    tools, shown = by_name(episode), []
    for name, arguments in calls:
        if name not in tools:
            result = episode.call(name, arguments)
            shown.append((result.text, result.is_error))
            continue
        message = tools[name].invoke({"type": "tool_call", "id": "c0", "name": name, "args": arguments})
        shown.append((message.content, message.status == "error"))
    return shown


def mcp(mode: str) -> Any:
    def send(episode: sp.Episode, calls: list[tuple[str, Any]]) -> list[tuple[str, bool]]:
        async def session() -> list[tuple[str, bool]]:
            table = Table(episode)
            async with Client(game_server(lambda _: table), mode=mode) as client:
                results = [await client.call_tool(name, arguments) for name, arguments in calls]
            return [(result.content[0].text, result.is_error) for result in results]

        return asyncio.run(session())

    return send


HOST = {
    "Episode": raw_episode,
    "Episode, async": raw_episode_async,
    "LangChain toolkit": toolkit,
    "MCP": mcp("auto"),
    "MCP, legacy": mcp("legacy"),
}


@pytest.mark.parametrize("row", HOST)
def test_the_game_cannot_tell_hosts_apart(row):
    conformance.judge_host(HOST[row])
