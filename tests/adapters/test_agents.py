"""The Agents SDK: behaviour of `SmartPlayModel` that the common conversation does not test."""

from __future__ import annotations

import json
from contextlib import asynccontextmanager
from typing import Any

import pytest
from agents import (
    Agent,
    ItemHelpers,
    MaxTurnsExceeded,
    ModelSettings,
    OpenAIChatCompletionsModel,
    OpenAIResponsesModel,
    Runner,
    SQLiteSession,
    ToolGuardrailFunctionOutput,
    WebSearchTool,
    set_tracing_disabled,
    tool_input_guardrail,
)
from agents.testing import ScriptedModel
from openai import AsyncOpenAI, DefaultAsyncHttpxClient
from smartplay_openai.agents import SmartPlayModel

import smartplay_tools as sp
from smartplay_tools.types.messages import text_of
from tests.adapters.as_recorded import as_recorded
from tests.adapters.conformance import WAY, act, calling, fresh, move
from tests.adapters.openai_stub import OpenAIStub
from tests.adapters.scripted_agents import ReadingModel, step

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def _no_traces():
    set_tracing_disabled(True)


async def run(episode: sp.Episode, script: list[sp.Message], tools: tuple = (), prompt: str | list = "", **options):
    inner = ScriptedModel([step(message) if isinstance(message, dict) else message for message in script])
    model = SmartPlayModel(inner, episode)
    agent = Agent("player", model=model, tools=[*model.tools, *tools], **options)
    result = await Runner.run(agent, prompt or [], max_turns=None, run_config=model.run_config)
    return inner, result


async def play(model: SmartPlayModel, prompt: Any = (), **options: Any) -> Any:
    """Run an agent that has the game's tools alone."""
    agent = Agent("player", model=model, tools=model.tools)
    return await Runner.run(agent, prompt or [], max_turns=None, run_config=model.run_config, **options)


async def test_an_agent_that_asks_its_provider_to_manage_the_context_says_so():
    settings = ModelSettings(context_management=[{"type": "compaction", "compact_threshold": 10**6}])
    episode, _ = fresh()
    with episode:
        await run(episode, [calling(act(short)) for short in WAY], model_settings=settings)
    usage = episode.result.tokens.provider
    assert usage is not None
    assert usage.managed == episode.result.turns


# --- Through the client, with a server that says what a script says -----------------------------------------------


@asynccontextmanager
async def models(script: list, *episodes: sp.Episode, kind: Any = OpenAIChatCompletionsModel):
    """A model of the SDK for each episode, and the server behind them."""
    http = DefaultAsyncHttpxClient(trust_env=False, verify=False)
    with OpenAIStub(script) as stub:
        async with AsyncOpenAI(base_url=stub.base_url, api_key="none", http_client=http, max_retries=0) as openai:
            yield [SmartPlayModel(kind("m", openai), episode) for episode in episodes], stub


@pytest.mark.parametrize("kind", [OpenAIChatCompletionsModel, OpenAIResponsesModel])
async def test_handoffs_are_counted_and_a_used_one_is_no_mistake(kind):
    budget = sp.Budget(prompt_tokens=900)
    episode, events = fresh(budget)
    there, back = ("transfer_to_second", {}), ("transfer_to_first", {})
    script = [calling(act("A->C")), calling(there), *map(calling, map(act, WAY[1:4])), calling(back)]
    script += [*map(calling, map(act, WAY[4:]))]
    async with models(script, episode, kind=kind) as ([model], stub):
        first = Agent("first", instructions="I am the first.", model=model, tools=model.tools)
        second = Agent("second", instructions="I am the second.", model=model, tools=model.tools, handoffs=[first])
        first.handoffs.append(second)
        with episode:
            await Runner.run(first, "Play!", max_turns=None, run_config=model.run_config)
    assert (episode.result.completed, episode.result.malformed_calls, episode.result.turns) == (True, 0, 9)
    assert max(event["tokens"] for event in events if event["event"] == "view") <= 900
    as_recorded(events, stub)
    instructions = [text_of(prompt.messages[2]) for prompt in stub.received]
    assert instructions == ["I am the first."] * 2 + ["I am the second."] * 4 + ["I am the first."] * 3


async def test_a_hosted_tool_is_refused_in_a_sentence():
    episode, events = fresh()
    with episode, pytest.raises(sp.InvalidArgumentError, match="'web_search' adds to a prompt cannot be counted"):
        await run(episode, [], (WebSearchTool(),))
    assert [event["event"] for event in events] == ["start", "end"]


async def test_a_handoff_to_an_agent_with_another_model_ends_a_closed_episode_as_the_hosts():
    episode, events = fresh()
    model = SmartPlayModel(
        ScriptedModel([step(calling(act(WAY[0]))), step(calling(("transfer_to_other", {})))]), episode
    )
    other = Agent("other", model=ScriptedModel([step(calling(say="I take over."))]))
    agent = Agent("player", model=model, tools=model.tools, handoffs=[other])
    with episode:
        result = await Runner.run(agent, [], max_turns=None, run_config=model.run_config)
    assert result.final_output == "I take over."
    detail = "The agent handed over with transfer_to_other, and this model was not asked again."
    assert (episode.result.end_reason, episode.result.detail, episode.result.steps) == ("host", detail, 1)
    assert sp.replay(events).identical


@pytest.mark.parametrize("streamed", [False, True])
async def test_a_run_has_the_requests_that_were_made_and_their_usage(streamed):
    """The words at the end are not a request; a compatible server may leave out the sum of its counts."""
    episode, _ = fresh()
    model = SmartPlayModel(WithoutSum([*map(calling, map(act, WAY))], sp.Usage(prompt=90, reply=9, cached=0)), episode)
    agent = Agent("player", model=model, tools=model.tools)
    options = {"max_turns": None, "run_config": model.run_config}
    with episode:
        if streamed:
            result = Runner.run_streamed(agent, "Play.", **options)
            async for _event in result.stream_events():
                pass
        else:
            result = await Runner.run(agent, "Play.", **options)
    used = result.context_wrapper.usage
    assert (used.requests, used.input_tokens, used.output_tokens) == (7, 7 * 90, 7 * 9)
    assert episode.result.tokens.provider == sp.Usage(prompt=7 * 90, reply=7 * 9, cached=0, requests=7)


class WithoutSum(ReadingModel):
    """A model whose usage has no sum."""

    async def get_response(self, *arguments: Any, **options: Any) -> Any:
        response = await super().get_response(*arguments, **options)
        response.usage.total_tokens = 0
        return response


async def test_a_second_episode_in_the_same_session_begins_afresh():
    one, _ = fresh(sp.Budget(tool_calls=1))
    two, events = fresh()
    script = [calling(act("A->C")), *map(calling, map(act, WAY))]
    session = SQLiteSession("1")
    async with models(script, one, two) as (both, stub):
        for model, words in zip(both, ("First game.", "Second game."), strict=True):
            with model.episode:
                await play(model, words, session=session)
    assert two.result.completed
    head = next(event["messages"] for event in events if event["event"] == "head")
    assert [text_of(message) for message in head[2:]] == ["Second game."]
    assert not any(
        "episode is over" in text_of(message) for prompt in stub.received[1:-1] for message in prompt.messages
    )
    session.close()


async def test_words_between_two_runs_are_counted_and_shown():
    episode, events = fresh()
    async with models([*map(calling, map(act, WAY))], episode) as ([model], stub):
        with episode:
            agent = Agent("player", model=model, tools=model.tools)
            with pytest.raises(MaxTurnsExceeded) as stopped:
                await Runner.run(agent, "Play!", max_turns=2, run_config=model.run_config)
            data = stopped.value.run_data
            items = [*ItemHelpers.input_to_new_input_list(data.input)]
            items += [item.to_input_item() for item in data.new_items]
            items.append({"role": "user", "content": "Hurry!"})
            await Runner.run(agent, items, max_turns=None, run_config=model.run_config)
    assert (episode.result.completed, episode.result.turns) == (True, 7)
    assert text_of(stub.received[2].messages[-1]) == "Hurry!"
    as_recorded(events, stub)


async def test_a_call_that_awaits_approval_is_not_played_by_a_later_one():
    episode, events = fresh()
    async with models([calling(act("A->C"), act("A->B")), *[calling(say="Well.")] * 3], episode) as ([model], _):
        for tool in model.tools:
            tool.needs_approval = by_action(move("A->C"))
        with episode:
            paused = await play(model)
            assert (len(paused.interruptions), episode.stats.steps) == (1, 0)
            state = paused.to_state()
            state.approve(paused.interruptions[0])
            await play(model, state)
    calls = sorted((event for event in events if event["event"] == "call"), key=lambda event: event["position"])
    assert [event.get("host") for event in calls] == [None, "refused"]
    assert episode.result.steps == 1
    assert sp.replay(events).identical


def by_action(action: str) -> Any:
    async def needs(_: Any, arguments: dict[str, Any], call_id: str) -> bool:
        return arguments.get("action") == action

    return needs


async def test_a_rejected_call_is_refused_in_the_hosts_words():
    episode, events = fresh()
    async with models([calling(act("A->C")), *[calling(say="Well.")] * 3], episode) as ([model], stub):
        for tool in model.tools:
            tool.needs_approval = True
        with episode:
            paused = await play(model)
            state = paused.to_state()
            state.reject(paused.interruptions[0])
            await play(model, state)
    (call,) = [event for event in events if event["event"] == "call"]
    assert call["host"] == "refused"
    assert text_of(stub.received[1].messages[-1]) == call["refusal"]
    assert (episode.result.steps, episode.result.refused_calls) == (0, 1)


def without(*actions: str) -> Any:
    """A guardrail that rejects some actions."""

    @tool_input_guardrail
    def guardrail(data: Any) -> ToolGuardrailFunctionOutput:
        action = json.loads(data.context.tool_arguments).get("action")
        if action in map(move, actions):
            return ToolGuardrailFunctionOutput.reject_content(f"Not {action}, please.")
        return ToolGuardrailFunctionOutput.allow()

    return guardrail


@pytest.mark.parametrize(
    ("calls", "played"),
    [
        ((act("A->B"),), [False]),
        ((act("A->B"), act("A->C")), [False, True]),
        ((act("A->C"), act("A->B")), [True, False]),
        ((act("A->B"), act("A->B"), act("A->C")), [False, False, True]),
    ],
    ids=["alone", "before another", "after another", "two before another"],
)
async def test_a_call_that_a_guardrail_rejected_has_the_guardrails_words_as_its_result(calls, played):
    episode, events = fresh()
    async with models([calling(*calls), *[calling(say="Well.")] * 3], episode) as ([model], stub):
        for tool in model.tools:
            tool.tool_input_guardrails = [without("A->B")]
        with episode:
            await play(model)
    record = sorted((event for event in events if event["event"] == "call"), key=lambda event: event["position"])
    assert [event.get("host") for event in record] == [None if ok else "refused" for ok in played]
    words = f"Not {move('A->B')}, please."
    assert [event.get("refusal", "") for event in record] == ["" if ok else words for ok in played]
    seen = [text_of(message) for message in stub.received[1].messages if message["role"] == "tool"]
    assert [text == words for text in seen] == [not ok for ok in played]
    assert (episode.result.steps, episode.result.refused_calls) == (sum(played), len(played) - sum(played))
    as_recorded(events, stub)


async def test_another_run_config_is_refused_in_a_sentence():
    episode, _ = fresh()
    async with models([calling(act("A->C"))], episode) as ([model], _):
        with episode, pytest.raises(Exception, match="order of the message"):
            await Runner.run(Agent("player", model=model, tools=model.tools), [])


async def test_a_reply_that_a_cancelled_run_has_not_seen_is_given_to_the_next_one():
    episode, events = fresh()
    script = [step(calling(act(each))) for each in WAY]
    model = SmartPlayModel(ScriptedModel(script), episode)
    agent = Agent("player", model=model, tools=model.tools)
    with episode:
        stopped = Runner.run_streamed(agent, "Play!", max_turns=None, run_config=model.run_config)
        async for _ in stopped.stream_events():
            if episode.stats.turns == 2:
                break
        stopped.cancel()
        items = stopped.to_input_list()
        assert sum(item.get("type") == "function_call" for item in items) == 1, "the second reply is not among them"
        late = [*items, {"role": "user", "content": "Hurry!"}]
        with pytest.raises(sp.InvalidArgumentError, match="without new messages"):
            await Runner.run(agent, late, max_turns=None, run_config=model.run_config)
        await Runner.run(agent, items, max_turns=None, run_config=model.run_config)
    assert (episode.result.completed, episode.result.turns, episode.result.steps) == (True, 7, 7)
    assert sp.replay(events).identical


async def test_a_run_goes_on_from_its_record():
    episode, events = fresh()
    async with models([*map(calling, map(act, WAY))], episode) as ([model], _):
        agent = Agent("player", model=model, tools=model.tools, instructions="Sir!")
        with pytest.raises(MaxTurnsExceeded) as stopped:
            await Runner.run(agent, "Play!", max_turns=3, run_config=model.run_config)
        items = ItemHelpers.input_to_new_input_list(stopped.value.run_data.input)
        items += [item.to_input_item() for item in stopped.value.run_data.new_items]
        record: list = []
        with sp.resume(list(events), transcript=record, session=True) as resumed:
            model = SmartPlayModel(model._model, resumed.conversation)
            agent = Agent("player", model=model, tools=model.tools, instructions="Sir!")
            await Runner.run(agent, items, max_turns=None, run_config=model.run_config)
    assert (resumed.episode.result.completed, resumed.episode.result.turns) == (True, 7)
    assert len([event for event in record if event["event"] == "head"]) == 1
    assert sp.replay(record).identical
