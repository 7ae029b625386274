"""What frameworks' own clients send for the providers' caches when an adapter plays: the bytes that a server receives.

Our own players are in `test_anthropic.py` and `test_openai.py`, Pydantic AI and Inspect in the files of their own
environments.
"""

from __future__ import annotations

import asyncio
from typing import Any

import pytest
from agents import Agent, ModelSettings, OpenAIChatCompletionsModel, OpenAIResponsesModel, Runner, set_tracing_disabled
from langchain.agents import create_agent
from openai import AsyncOpenAI
from smartplay_langchain import GraphSession, LangChainPlayer, SmartPlayMiddleware
from smartplay_openai.agents import SmartPlayModel

import smartplay_tools as sp
from tests.adapters import rerouted
from tests.adapters.anthropic_stub import AnthropicStub
from tests.adapters.conformance import act, calling, fresh
from tests.adapters.marks import anthropic_marks, openai_marks
from tests.adapters.openai_stub import OpenAIStub

pytestmark = pytest.mark.slow

ChatAnthropic = pytest.importorskip("langchain_anthropic").ChatAnthropic
ChatOpenAI = pytest.importorskip("langchain_openai").ChatOpenAI

SCRIPT = [calling(act(move)) for move in ("A->C", "A->B", "C->B")]
BUDGET = sp.Budget(tool_calls=3)

AT_OPENAI = "https://api.openai.com/v1"


@pytest.fixture(autouse=True)
def _quiet(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    set_tracing_disabled(True)


class Anthropic(AnthropicStub):
    is_strict = False


class OpenAI(OpenAIStub):
    is_strict = False


# LangChain: the player, an agent, and a graph of one's own.


def as_player(episode: sp.Episode, model: Any, **options: Any) -> None:
    sp.play(episode, LangChainPlayer(model, **options))


def as_agent(episode: sp.Episode, model: Any, **options: Any) -> None:
    create_agent(model, middleware=[SmartPlayMiddleware(episode, **options)]).invoke({"messages": []})


def as_async_agent(episode: sp.Episode, model: Any, **options: Any) -> None:
    agent = create_agent(model, middleware=[SmartPlayMiddleware(episode, **options)])
    asyncio.run(agent.ainvoke({"messages": []}))


def as_graph(episode: sp.Episode, model: Any, **options: Any) -> None:
    session = GraphSession(episode, **options)
    state: list[Any] = []
    play = {tool.name: tool for tool in session.tools}
    while not episode.done:
        state += session.ask(model, state)
        state += [play[call["name"]].invoke({**call, "type": "tool_call"}) for call in state[-1].tool_calls]


WAYS = (as_player, as_agent, as_async_agent, as_graph)


@pytest.mark.parametrize(
    ("play", "options", "places"),
    [(way, {}, [[1], [1, 3], [3, 5]]) for way in WAYS]
    + [(as_player, {"cache": "stable"}, [[], [1], [3]]), (as_agent, {"cache": False}, [[], [], []])],
)
def test_langchain_marks_prompts_for_anthropic(play, options, places):
    episode, _ = fresh(BUDGET)
    with Anthropic(SCRIPT) as stub, episode:
        model = ChatAnthropic(model_name="claude-opus-5", base_url=stub.url, api_key="k", max_retries=0)
        play(episode, model, **{"summary_tool_choice": {"type": "none"}, **options})
    assert [anthropic_marks(body) for body in stub.bodies] == places


@pytest.mark.parametrize("responses", [False, True])
@pytest.mark.parametrize(
    ("play", "model", "options", "has_key", "places"),
    [(way, "gpt-5.6", {}, True, [[], [1], [3]]) for way in WAYS]
    + [(as_player, "gpt-5.5", {}, True, [[], [], []]), (as_agent, "gpt-5.6", {"cache": False}, False, [[], [], []])],
)
def test_langchain_tells_openai_the_episode_and_what_is_stable(play, responses, model, options, has_key, places):
    episode, _ = fresh(BUDGET)
    with OpenAI(SCRIPT) as stub, rerouted.clients(stub.url) as clients, episode:
        chat = ChatOpenAI(model=model, api_key="k", use_responses_api=responses, max_retries=0, **clients)
        play(episode, chat, **options)
    assert {body.get("prompt_cache_key") for body in stub.bodies} == {episode.config.key if has_key else None}
    assert [openai_marks(body) for body in stub.bodies] == places


def test_langchain_leaves_other_servers_and_other_keys_alone():
    episode, _ = fresh(BUDGET)
    with OpenAI(SCRIPT) as stub, episode:
        as_player(episode, ChatOpenAI(model="gpt-5.6", api_key="k", base_url=stub.base_url, max_retries=0))
    assert [("prompt_cache_key" in body, openai_marks(body)) for body in stub.bodies] == [(False, [])] * 3
    episode, _ = fresh(BUDGET)
    with OpenAI(SCRIPT) as stub, rerouted.clients(stub.url) as clients, episode:
        own = {"model_kwargs": {"prompt_cache_key": "mine"}}
        as_player(episode, ChatOpenAI(model="gpt-5.5", api_key="k", max_retries=0, **own, **clients))
    assert {body["prompt_cache_key"] for body in stub.bodies} == {"mine"}


def test_langchains_own_middleware_for_anthropics_cache_is_not_added_to():
    from langchain_anthropic.middleware import AnthropicPromptCachingMiddleware

    episode, _ = fresh(BUDGET)
    with Anthropic(SCRIPT) as stub, episode:
        model = ChatAnthropic(model_name="claude-opus-5", base_url=stub.url, api_key="k", max_retries=0)
        own = AnthropicPromptCachingMiddleware(ttl="1h")
        create_agent(model, middleware=[own, SmartPlayMiddleware(episode)]).invoke({"messages": []})
    assert [anthropic_marks(body) for body in stub.bodies] == [[], [], []]
    assert all(body["cache_control"] == {"type": "ephemeral", "ttl": "1h"} for body in stub.bodies)


# The Agents SDK.


async def run(model: str, kind: Any, settings: ModelSettings, **options: Any) -> tuple[OpenAI, str]:
    episode, _ = fresh(BUDGET)
    with OpenAI(SCRIPT) as stub, rerouted.clients(stub.url) as clients, episode:
        http = clients["http_async_client"]
        async with AsyncOpenAI(base_url=AT_OPENAI, api_key="k", http_client=http, max_retries=0) as openai:
            player = SmartPlayModel(kind(model, openai), episode, **options)
            agent = Agent("player", model=player, tools=player.tools, model_settings=settings)
            await Runner.run(agent, [], max_turns=None, run_config=player.run_config)
    return stub, episode.config.key


@pytest.mark.parametrize("kind", [OpenAIChatCompletionsModel, OpenAIResponsesModel])
@pytest.mark.parametrize(
    ("model", "options", "has_key", "places"),
    [
        ("gpt-5.5", {}, True, [[], [], []]),
        ("gpt-5.6", {}, True, [[], [1], [3]]),
        ("gpt-5.6", {"cache": False}, False, [[], [], []]),
    ],
)
async def test_the_agents_sdk_tells_openai_the_episode_and_what_is_stable(kind, model, options, has_key, places):
    stub, key = await run(model, kind, ModelSettings(), **options)
    assert {body.get("prompt_cache_key") for body in stub.bodies} == {key if has_key else None}
    assert [openai_marks(body) for body in stub.bodies] == places


async def test_a_key_of_the_agents_own_settings_stays():
    settings = ModelSettings(extra_args={"prompt_cache_key": "mine"})
    stub, _ = await run("gpt-5.6", OpenAIResponsesModel, settings)
    assert {body["prompt_cache_key"] for body in stub.bodies} == {"mine"}
