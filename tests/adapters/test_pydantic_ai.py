"""Pydantic AI, with its own `FunctionModel`: `.ci/run` has an environment with it."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("pydantic_ai", reason="needs smartplay-tools[pydantic-ai]; `.ci/run` has an environment with it")

from pydantic_ai import Agent, BinaryContent, Tool, UsageLimitExceeded
from pydantic_ai.capabilities import AbstractCapability, PrepareTools, ProcessHistory
from pydantic_ai.messages import ModelMessage, ModelResponse, TextPart, ThinkingPart, ToolCallPart, ToolReturnPart
from pydantic_ai.models.function import AgentInfo, FunctionModel
from pydantic_ai.models.openai import OpenAIChatModel
from pydantic_ai.providers.openai import OpenAIProvider
from pydantic_ai.settings import ModelSettings
from pydantic_ai.usage import RequestUsage, UsageLimits
from smartplay_pydantic_ai import PlayerModel, SmartPlay
from smartplay_pydantic_ai.messages import from_response, usage_of

import smartplay_tools as sp
from tests.adapters.conformance import (
    EACH,
    SEED,
    WAY,
    WEATHER,
    Held,
    Sent,
    Window,
    WindowConformance,
    act,
    calling,
    fresh,
    judge_interleaved,
    one_system,
    received,
)
from tests.adapters.openai_stub import OpenAIStub
from tests.adapters.situations import REFUSED, SituationConformance, weather
from tests.processes import printed_by

pytestmark = pytest.mark.filterwarnings("ignore")

NO_LIMIT = UsageLimits(request_limit=None)
THE_END = "The episode is over."


class Scripted:
    """A model that says what a script says, and keeps what it was sent."""

    def __init__(self, script: Iterable[sp.Message], usage: sp.Usage | None = None) -> None:
        self.player = sp.ScriptedPlayer(script, usage)
        self.model = PlayerModel(self.player)

    @property
    def received(self) -> Sent:
        return [each._replace(messages=one_system(each.messages)) for each in map(received, self.player.prompts)]


def camera() -> list[Any]:
    """Take a picture."""
    return ["Here.", BinaryContent(b"", media_type="image/png")]


def hold(episode: sp.Episode, script: Iterable[sp.Message], *, own_cap: int | None = None, situation: str = "") -> Held:
    model, capability = Scripted(script, EACH), SmartPlay(episode)

    async def helper() -> str:
        """Play for the agent."""
        other = Agent(model.model, capabilities=[capability])
        return (await other.run("Play.", usage_limits=NO_LIMIT)).output

    own = {} if own_cap is None else {"max_tokens": own_cap}
    own |= {"tool_choice": "none"} if situation == "no calls" else {}
    described = Tool.from_schema(weather, WEATHER.name, WEATHER.description, dict(WEATHER.parameters))
    other, _ = fresh(seed=SEED + 1)
    others: dict[str, list[AbstractCapability[Any]]] = {
        "another episode instead": [SmartPlay(other)],
        "forgets": [ProcessHistory(lambda messages: messages[-2:])],
        "no tools": [PrepareTools(lambda context, tools: [])],
        "withdrawn": [
            PrepareTools(lambda context, tools: [t for t in tools if t.name != WEATHER.name or not model.received])
        ],
    }
    agent = Agent(
        model.model,
        capabilities=[*others.get(situation, []), capability],
        model_settings=ModelSettings(**own),
        tools={
            "another episode": [*other.functions()],
            "broken call": [described],
            "withdrawn": [described],
            "picture": [camera],
            "sub-agent": [helper],
        }.get(situation, []),
        output_type=dict[str, int] if situation == "schema" else str,
    )
    result = agent.run_sync("", usage_limits=NO_LIMIT)
    if situation == "again":
        result = agent.run_sync("", usage_limits=NO_LIMIT)
    assert result.output == THE_END
    return Held(
        model.received, sp.Usage(prompt=result.usage.input_tokens, reply=result.usage.output_tokens), result.output
    )


class TestConformance(SituationConformance, WindowConformance):
    row = Window(hold, "Pydantic AI `SmartPlay`", refuses=REFUSED)

    def test_two_episodes_interleaved(self):
        judge_interleaved(self.row)


def test_the_example_evaluates_an_agent(tmp_path):
    example = Path(__file__).parents[2] / "examples" / "16_evaluate_pydantic_ai.py"
    environment = {name: value for name, value in os.environ.items() if name != "SMARTPLAY_MODEL"}
    command = [sys.executable, "-W", "error", str(example)]
    shown = printed_by(*command, cwd=tmp_path, env=environment)
    assert shown.count("score 3  terminated") == 3


def test_the_history_of_the_agent_keeps_everything():
    episode, _ = fresh(sp.Budget(prompt_tokens=700))
    with episode:
        agent = Agent(PlayerModel(sp.get_player("rule")), capabilities=[SmartPlay(episode)])
        result = agent.run_sync("", usage_limits=NO_LIMIT)
    assert episode.result.completed
    calls = [p for m in result.all_messages() for p in m.parts if isinstance(p, ToolCallPart)]
    answers = [p for m in result.all_messages() for p in m.parts if isinstance(p, ToolReturnPart)]
    assert len(calls) == len(answers) == episode.result.tool_calls


def test_a_mistake_is_a_failed_call_in_the_history():
    episode, _ = fresh(sp.Budget(tool_calls=1))
    with episode:
        model = Scripted([calling(("act", {"action": "Fly"}))])
        result = Agent(model.model, capabilities=[SmartPlay(episode)]).run_sync("", usage_limits=NO_LIMIT)
    (answer,) = [p for m in result.all_messages() for p in m.parts if isinstance(p, ToolReturnPart)]
    assert (answer.outcome, episode.result.illegal_actions) == ("failed", 1)


def test_the_hosts_words_and_tools_are_counted_and_shown():
    episode, events = fresh()
    script = [calling(("search", {"query": "towers"}), act("A->C")), *[calling(say="Done.")] * 3]
    model = Scripted(script)
    agent = Agent(model.model, capabilities=[SmartPlay(episode)], instructions="Sir!", system_prompt="Be brave.")

    @agent.tool_plain
    def search(query: str) -> str:
        """Search the web."""
        return f"Nothing about {query}."

    with episode:
        agent.run_sync("Be quick.", usage_limits=NO_LIMIT)
    first, second = (list(prompt.messages) for prompt in model.received[:2])
    assert first[0]["content"].endswith("Sir!\n\nBe brave.")
    assert first[-1] == {"role": "user", "content": "Be quick."}
    assert [message["role"] for message in second[-3:]] == ["assistant", "tool", "tool"]
    assert "Nothing about towers." in [message["content"] for message in second[-2:]]
    (head,) = [event for event in events if event["event"] == "head"]
    assert head["tools"][-1]["name"] == "search"


def test_a_limit_of_the_agents_ends_the_episode_as_the_hosts():
    episode, _ = fresh()
    with episode, pytest.raises(UsageLimitExceeded):
        Agent(Scripted([calling(("observe", {}))] * 9).model, capabilities=[SmartPlay(episode)]).run_sync(
            "", usage_limits=UsageLimits(request_limit=3)
        )
    assert (episode.result.end_reason, episode.result.turns) == ("host", 3)
    assert "request_limit of 3" in episode.result.detail


def test_an_agent_that_asks_its_provider_to_manage_the_context_says_so():
    settings: Any = {"anthropic_context_management": {"edits": [{"type": "clear_tool_uses_20250919"}]}}
    episode, _ = fresh()
    with episode:
        agent = Agent(Scripted(calling(act(short)) for short in WAY).model, capabilities=[SmartPlay(episode)])
        agent.run_sync("", usage_limits=NO_LIMIT, model_settings=settings)
    assert episode.result.tokens.provider.managed == episode.result.turns


def test_a_model_that_fails_once_can_be_asked_again():
    failures = iter([RuntimeError("busy")])
    rule = PlayerModel(sp.get_player("rule"))

    async def answer(messages: list[ModelMessage], info: AgentInfo) -> ModelResponse:
        for error in failures:
            raise error
        return await rule.function(messages, info)

    episode, _ = fresh()
    with episode:
        agent = Agent(FunctionModel(answer), capabilities=[SmartPlay(episode)])
        with pytest.raises(RuntimeError, match="busy"):
            agent.run_sync("", usage_limits=NO_LIMIT)
        assert agent.run_sync("", usage_limits=NO_LIMIT).output == THE_END
    assert episode.result.completed


@pytest.mark.parametrize(("reason", "cut"), [("length", 1), ("stop", 0), (None, 0)])
def test_a_reply_that_was_cut_at_its_length_is_counted_as_one(reason, cut):
    usage = RequestUsage(input_tokens=9, output_tokens=2)
    response = ModelResponse([TextPart("I thi")], usage=usage, finish_reason=reason)
    assert usage_of(response) == sp.Usage(prompt=9, reply=2, cached=0, cut=cut)
    without = ModelResponse([TextPart("I thi")], finish_reason=reason)
    assert usage_of(without) == (sp.Usage(cut=1) if cut else None)


def test_all_that_a_player_reports_arrives():
    usage = sp.Usage(prompt=90, reply=9, cached=40, written=30, reasoning=7, cut=1)
    agent = Agent(PlayerModel(sp.ScriptedPlayer([calling(say="I am")], usage)))
    response = agent.run_sync("Go.").all_messages()[-1]
    assert isinstance(response, ModelResponse)
    assert usage_of(response) == usage


def test_records_of_replies_have_no_times():
    response = ModelResponse([ThinkingPart("Hm."), TextPart("Rock.")])
    again = ModelResponse([ThinkingPart("Hm."), TextPart("Rock.")])
    assert from_response(response) == from_response(again)


async def test_a_streamed_run_is_refused():
    async def stream(messages: list[ModelMessage], info: AgentInfo) -> Any:
        yield "Hello."

    episode, _ = fresh()
    agent = Agent(FunctionModel(stream_function=stream), capabilities=[SmartPlay(episode)])
    with episode, pytest.raises(sp.InvalidArgumentError, match="streamed"):
        async with agent.run_stream("", usage_limits=NO_LIMIT) as running:
            await running.get_output()


MOVES = [calling(act(short)) for short in ("A->C", "A->B", "C->B")]
THREE_MOVES = sp.Budget(tool_calls=3, reply_tokens=100)


class OpenAI(OpenAIStub):
    is_strict = False


def test_half_a_character_is_recorded_and_rewritten_in_requests_alone():
    events: list[Any] = []
    episode = sp.Episode("Hanoi3Disk-v0", seed=7, budget=THREE_MOVES, transcript=events)
    odd = calling(("act", '{"action": "\\ud83d"}'), say="\ud83d")
    with OpenAI([odd, *MOVES]) as stub, episode:
        model = OpenAIChatModel("m", provider=OpenAIProvider(base_url=stub.base_url, api_key="k"))
        Agent(model, capabilities=[SmartPlay(episode)]).run_sync("", usage_limits=NO_LIMIT)
    assert episode.result.end_reason == "tool_calls"
    assert "\ufffd" in stub.bodies[1]["messages"][-2]["content"]
    assert next(event for event in events if event["event"] == "message")["message"]["content"] == "\ud83d"
