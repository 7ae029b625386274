"""Summaries in agents of other frameworks: their real clients ask a server on this machine, which says what it is told.

A window that owes a summary has the model called once more, inside the framework's own call of the model. The agent
sees one reply; the provider sees a request with the tools, of which none is chosen.
"""

from __future__ import annotations

import asyncio
import itertools
from collections.abc import Callable
from functools import cache, partial
from typing import Any, ClassVar, NamedTuple

import pytest
from agents import (
    Agent,
    ModelRetrySettings,
    ModelSettings,
    OpenAIChatCompletionsModel,
    OpenAIResponsesModel,
    Runner,
    retry_policies,
    set_tracing_disabled,
)
from langchain.agents import create_agent
from langchain.agents.middleware import ModelRetryMiddleware, dynamic_prompt
from langchain_core.callbacks import BaseCallbackHandler
from langchain_core.messages import BaseMessage
from langgraph.graph import MessagesState
from langgraph.types import RetryPolicy
from openai import AsyncOpenAI, DefaultAsyncHttpxClient
from smartplay_langchain import GraphSession, LangChainPlayer, SmartPlayMiddleware
from smartplay_openai.agents import SmartPlayModel

import smartplay_tools as sp
from smartplay_tools.records.prompts import sent_prompts
from tests.adapters.as_recorded import as_recorded
from tests.adapters.conformance import calling, fresh
from tests.adapters.openai_stub import OpenAIStub
from tests.adapters.scripted_langchain import playing_graph

pytestmark = pytest.mark.slow

ChatOpenAI = pytest.importorskip("langchain_openai").ChatOpenAI

TURNS = 14
BUDGET = sp.Budget(prompt_tokens=850, summary_tokens=60, slack=0.5, tool_calls=TURNS, stalled_turns=None)
THREAD = {"configurable": {"thread_id": "1"}, "recursion_limit": 1000}
WORDS = "All disks are still on A."


@pytest.fixture(autouse=True)
def _no_traces() -> None:
    set_tracing_disabled(True)


class Provider(OpenAIStub):
    """Calls `observe` in every reply, and writes a summary where it must call no tool.

    `fails` says of a request, by what it asks for and its number among those, whether it is answered with an error.
    """

    def __init__(self, fails: Callable[[str, int], bool] = lambda purpose, number: False) -> None:
        script = itertools.repeat(calling(("observe", {}), say="I look again and again."))
        super().__init__(script, sp.Usage(prompt=100, reply=10))
        self._fails = fails
        self._numbers = {"play": itertools.count(), "summary": itertools.count()}

    @property
    def purposes(self) -> list[str]:
        return [purpose_of(body) for body in self.bodies]

    def _answer(self, path: str, body: dict[str, Any]) -> tuple[int, dict[str, Any]]:
        purpose = purpose_of(body)
        if self._fails(purpose, next(self._numbers[purpose])):
            return 500, {"error": {"message": "down"}}
        return super()._answer(path, body)

    def say(self, path: str, body: dict[str, Any], message: Any) -> dict[str, Any]:
        answer = super().say(path, body, calling(say=WORDS) if purpose_of(body) == "summary" else message)
        for number, item in enumerate(answer.get("output", ())):
            item["call_id"] = f"c{len(self.requests)}.{number}"
        return answer


def purpose_of(body: dict[str, Any]) -> str:
    return "summary" if body.get("tool_choice") == "none" else "play"


# --- The hosts: each plays an episode to its end, and retries failed calls of the model as often as asked ------------


def client(stub: OpenAIStub) -> Any:
    return ChatOpenAI(model="m", base_url=stub.base_url, api_key="none", max_retries=0)


def langchain_agent(episode: sp.Episode, stub: Provider, retries: int = 0, *, asynchronously: bool = False) -> Any:
    """Returns the messages of the final state."""
    retry = ModelRetryMiddleware(max_retries=retries, initial_delay=0.0, jitter=False, on_failure="error")
    model = client(stub)
    agent = create_agent(model, middleware=[retry, SmartPlayMiddleware(episode)])
    return run(agent, model, asynchronously)


def langgraph(episode: sp.Episode, stub: Provider, retries: int = 0, *, asynchronously: bool = False) -> Any:
    """Returns the messages of the final state."""
    session, model = GraphSession(episode), client(stub)

    def speak(state: MessagesState) -> Any:
        return {"messages": session.ask(model, state["messages"])}

    async def aspeak(state: MessagesState) -> Any:
        return {"messages": await session.aask(model, state["messages"])}

    policy = RetryPolicy(max_attempts=retries + 1, initial_interval=0.0, jitter=False, retry_on=Exception)
    graph = playing_graph(session, aspeak if asynchronously else speak, retry_policy=policy)
    return run(graph, model, asynchronously)


def run(graph: Any, model: Any, asynchronously: bool) -> list[BaseMessage]:
    if not asynchronously:
        return graph.invoke({"messages": []}, THREAD)["messages"]
    with asyncio.Runner() as runner:
        try:
            return runner.run(graph.ainvoke({"messages": []}, THREAD))["messages"]
        finally:
            runner.run(model.root_async_client.close())


def agents_sdk(
    episode: sp.Episode,
    stub: Provider,
    retries: int = 0,
    *,
    kind: Any = OpenAIChatCompletionsModel,
    streamed: bool = False,
    **options: Any,
) -> Any:
    """Returns the result of the run."""
    policy = retry_policies.http_status([500])
    settings = ModelSettings(
        retry=ModelRetrySettings(max_retries=retries, backoff={"initial_delay": 0.0}, policy=policy)
    )

    async def play() -> Any:
        http = DefaultAsyncHttpxClient(trust_env=False, verify=False)
        async with AsyncOpenAI(base_url=stub.base_url, api_key="none", http_client=http, max_retries=0) as openai:
            model = SmartPlayModel(kind("m", openai), episode)
            agent = Agent("player", model=model, tools=model.tools, model_settings=settings, **options)
            if not streamed:
                return await Runner.run(agent, [], max_turns=None, run_config=model.run_config)
            running = Runner.run_streamed(agent, [], max_turns=None, run_config=model.run_config)
            async for _ in running.stream_events():
                pass
            return running

    return asyncio.run(play())


HOSTS = {
    "LangChain agent": langchain_agent,
    "LangChain agent, async": partial(langchain_agent, asynchronously=True),
    "LangGraph": langgraph,
    "LangGraph, async": partial(langgraph, asynchronously=True),
    "Agents SDK, chat completions": agents_sdk,
    "Agents SDK, Responses": partial(agents_sdk, kind=OpenAIResponsesModel),
    "Agents SDK, streamed": partial(agents_sdk, streamed=True),
}

in_every_host = pytest.mark.parametrize("host", HOSTS)


def as_asked(events: list[Any], stub: Provider) -> None:
    """The server received what the record says was sent, summaries included."""
    assert [prompt.prompt.purpose for prompt in sent_prompts(events)] == stub.purposes
    as_recorded(events, stub)


class Played(NamedTuple):
    result: sp.EpisodeResult
    events: list[Any]
    stub: Provider
    returned: Any
    """What the host returned."""


@cache
def undisturbed(host: str) -> Played:
    """An episode in a host, without any failure."""
    episode, events = fresh(BUDGET)
    with Provider() as stub, episode:
        returned = HOSTS[host](episode, stub)
    assert episode.result is not None
    return Played(episode.result, events, stub, returned)


@in_every_host
def test_a_summary_is_one_more_call_of_the_model_that_the_agent_does_not_see(host):
    result, events, stub, _ = undisturbed(host)
    assert (result.end_reason, result.turns) == ("tool_calls", TURNS)
    assert result.summaries == stub.purposes.count("summary") > 1
    asked = [body for body in stub.bodies if purpose_of(body) == "summary"]
    assert all(len(body["tools"]) == 3 for body in asked)
    assert all("about to leave your view" in str(body) for body in asked)
    assert all(WORDS in str(body) for body in stub.bodies[stub.purposes.index("summary") + 1 :])
    as_asked(events, stub)


def test_a_state_of_langchain_has_no_summary():
    messages = undisturbed("LangChain agent").returned
    assert [message.type for message in messages] == ["ai", "tool"] * TURNS
    assert not any(WORDS in message.text for message in messages)


def test_callbacks_of_langchain_tell_a_summary_by_its_tag():
    class Watching(BaseCallbackHandler):
        purposes: ClassVar[list[str]] = []

        def on_chat_model_start(self, serialized: Any, messages: Any, *, tags: Any = None, **details: Any) -> None:
            self.purposes.append("summary" if "smartplay-summary" in (tags or ()) else "play")

    episode, _ = fresh(BUDGET)
    with Provider() as stub, episode:
        agent = create_agent(client(stub), middleware=[SmartPlayMiddleware(episode)])
        agent.invoke({"messages": []}, {**THREAD, "callbacks": [Watching()]})
    assert Watching.purposes == stub.purposes


@in_every_host
def test_calls_that_failed_are_made_again_and_no_summary_is_paid_for_twice(host):
    """The first request for a summary fails once, and so does the prompt to play after it."""
    first = undisturbed(host).stub.purposes.index("summary")
    failing = {("summary", 0), ("play", first)}
    episode, events = fresh(BUDGET)
    with Provider(lambda *asked: asked in failing) as stub, episode:
        HOSTS[host](episode, stub, retries=2)
    assert episode.result == undisturbed(host).result
    assert stub.bodies == undisturbed(host).stub.bodies
    as_asked(events, stub)


def test_a_head_that_changes_is_refused_in_a_sentence():
    numbers, (episode, _) = itertools.count(), fresh(BUDGET)
    changing = dynamic_prompt(lambda request: f"This is prompt {next(numbers)}.")
    sentence = "Where turns are summarised or rewritten, the head of an episode cannot change."
    with Provider() as stub, episode, pytest.raises(sp.InvalidArgumentError, match=sentence):
        create_agent(client(stub), middleware=[changing, SmartPlayMiddleware(episode)]).invoke({"messages": []}, THREAD)


@pytest.mark.parametrize("choice", ["none", {"type": "none"}])
def test_the_choice_is_spelled_as_the_models_provider_spells_it(choice):
    """LangChain's client of Anthropic reads the word as the name of a tool, and passes an object on."""

    class Listening(ChatOpenAI):  # type: ignore[misc,valid-type]
        def bind_tools(self, tools: Any, *, tool_choice: Any = None, **settings: Any) -> Any:
            chosen.append(tool_choice)
            return super().bind_tools(tools, tool_choice=tool_choice and "none", **settings)

    chosen: list[Any]
    for play in (by_agent, by_player):
        chosen, (episode, _) = [], fresh(BUDGET)
        with Provider() as stub, episode:
            play(episode, Listening(model="m", base_url=stub.base_url, api_key="none"), choice)
        assert [purpose for purpose in chosen if purpose] == [choice] * episode.result.summaries != []


def by_agent(episode: sp.Episode, model: Any, choice: Any) -> None:
    agent = create_agent(model, middleware=[SmartPlayMiddleware(episode, summary_tool_choice=choice)])
    agent.invoke({"messages": []}, THREAD)


def by_player(episode: sp.Episode, model: Any, choice: Any) -> None:
    sp.play(episode, LangChainPlayer(model, summary_tool_choice=choice))
