"""SmartPlayMiddleware among LangChain's own middlewares: what each of them does still means what its users expect.

The agent's model is LangChain's client of OpenAI, and a server on this machine says what a script says.
"""

from __future__ import annotations

import asyncio
import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import openai
import pytest
from langchain.agents import create_agent
from langchain.agents.middleware import (
    AgentMiddleware,
    HumanInTheLoopMiddleware,
    ModelCallLimitMiddleware,
    ModelFallbackMiddleware,
    ModelRetryMiddleware,
    ToolCallLimitMiddleware,
    dynamic_prompt,
    wrap_model_call,
    wrap_tool_call,
)
from langchain_core.messages import AIMessage, SystemMessage, ToolMessage
from langchain_core.tools import tool
from langgraph.checkpoint.memory import InMemorySaver
from langgraph.types import Command
from smartplay_langchain import SmartPlayMiddleware

import smartplay_tools as sp
from smartplay_tools.types.messages import text_of
from tests.adapters.as_recorded import as_recorded
from tests.adapters.conformance import WAY, act, calling, fresh, move
from tests.adapters.openai_stub import OpenAIStub
from tests.adapters.scripted_langchain import Reminder, ScriptedModel, needs_single_approvals

pytestmark = pytest.mark.slow

ChatOpenAI = pytest.importorskip("langchain_openai").ChatOpenAI

THREAD = {"configurable": {"thread_id": "1"}}


def client(stub: OpenAIStub) -> Any:
    # Its own is kept for an address, so another test at the same port would get the one that was closed here.
    own = openai.DefaultAsyncHttpxClient()
    return ChatOpenAI(model="m", base_url=stub.base_url, api_key="none", max_retries=0, http_async_client=own)


@contextmanager
def invoking(agent: Any, model: Any, asynchronously: bool) -> Iterator[Callable[[Any], Any]]:
    """What invokes the agent, on one event loop or on none."""
    if not asynchronously:
        yield lambda sent: agent.invoke(sent, THREAD)
        return
    with asyncio.Runner() as runner:
        yield lambda sent: runner.run(agent.ainvoke(sent, THREAD))
        runner.run(model.root_async_client.close())


class Broken(OpenAIStub):
    """A server that is down: it answers 500, always."""

    attempts = 0

    def _answer(self, path: str, body: dict[str, Any]) -> tuple[int, dict[str, Any]]:
        self.attempts += 1
        return 500, {"error": {"message": "down"}}


def play(
    script: Iterable[Any], middlewares: Callable[[Any], list[Any]], budget: sp.Budget | None = None, **options: Any
) -> tuple[sp.EpisodeResult, list[Any], list[Any], list[Any]]:
    """Result, record, requests and final state of an agent's run; asynchronously if `asynchronously`."""
    asynchronously, messages = options.pop("asynchronously", False), options.pop("messages", [])
    episode, events = fresh(budget)
    with OpenAIStub(script) as stub, episode:
        model = client(stub)
        agent = create_agent(model, middleware=middlewares(SmartPlayMiddleware(episode)), **options)
        with invoking(agent, model, asynchronously) as invoke:
            state = invoke({"messages": messages})
    assert sp.replay(events).identical
    as_recorded(events, stub)
    return episode.result, events, stub.bodies, state["messages"]


def results(messages: list[Any]) -> list[ToolMessage]:
    return [message for message in messages if isinstance(message, ToolMessage)]


# --- What other middlewares add to the prompt ---------------------------------------------------------------------


@pytest.mark.parametrize("asynchronously", [False, True])
@pytest.mark.parametrize("inside", [False, True])
def test_texts_that_a_middleware_adds_are_counted_and_recorded(inside, asynchronously):
    budget, moves = sp.Budget(prompt_tokens=900), [calling(act("A->B")), calling(act("B->A"))] * 4
    words = "Remember to think about the smallest disk. " * 4

    def order(ours: Any) -> list[Any]:
        return [ours, Reminder(words)] if inside else [Reminder(words), ours]

    result, events, bodies, _ = play(
        [*moves, *[calling(say="Done.")] * 3], order, budget, asynchronously=asynchronously
    )
    assert result.steps == 8
    assert all(any(text_of(m) == words for m in body["messages"]) for body in bodies)
    assert max(event["tokens"] for event in events if event["event"] == "view") <= 900


def test_texts_that_leave_no_room_end_the_episode_before_the_model_is_called():
    result, _, bodies, state = play(
        [calling(act("A->C"))] * 3, lambda ours: [ours, Later("word " * 800)], sp.Budget(prompt_tokens=900)
    )
    assert (result.end_reason, len(bodies)) == ("prompt_tokens", 1)
    assert state[-1].text == "The episode is over."


class Later(Reminder):
    """Adds its message from the second request on."""

    def wrap_model_call(self, request: Any, handler: Any) -> Any:
        return super().wrap_model_call(request, handler) if request.messages else handler(request)


def test_a_system_text_that_does_not_fit_is_refused_in_a_sentence():
    @dynamic_prompt
    def longer(request: Any) -> str:
        return "word " * (900 if request.messages else 1)

    with pytest.raises(sp.InvalidArgumentError, match="prompt_tokens"):
        play([calling(act("A->C"))] * 3, lambda ours: [ours, longer], sp.Budget(prompt_tokens=900))


@pytest.mark.parametrize("inside", [False, True])
def test_a_dynamic_prompt_is_dynamic(inside):
    @dynamic_prompt
    def dynamic(request: Any) -> str:
        return f"There are {len(request.messages)} messages."

    script = [*map(calling, map(act, WAY))]
    result, _, bodies, _ = play(script, lambda ours: [ours, dynamic] if inside else [dynamic, ours])
    assert result.completed
    systems = [text_of(body["messages"][0]) for body in bodies]
    assert [system[-len("There are 0 messages.") :].strip() for system in systems[:3]] == [
        "There are 0 messages.",
        "There are 2 messages.",
        "There are 4 messages.",
    ]


def test_an_assistant_message_added_during_the_game_is_refused_in_a_sentence():
    @wrap_model_call
    def example(request: Any, handler: Any) -> Any:
        added = [AIMessage("I like A->C.")] if request.messages else []
        return handler(request.override(messages=[*request.messages, *added]))

    with pytest.raises(sp.InvalidArgumentError, match="only user and system messages"):
        play([calling(act("A->C"))] * 3, lambda ours: [ours, example])


def test_a_system_message_among_the_messages_is_part_of_the_system_text():
    @wrap_model_call
    def rules(request: Any, handler: Any) -> Any:
        return handler(request.override(messages=[*request.messages, SystemMessage("Speak French.")]))

    _, _, bodies, _ = play([*map(calling, map(act, WAY))], lambda ours: [ours, rules])
    assert all(text_of(body["messages"][0]).endswith("Speak French.") for body in bodies)


def test_tools_may_change_and_the_games_tools_may_not():
    @tool
    def search(query: str) -> str:
        """Search the web."""
        return f"Nothing about {query}."

    def without(name: str, after: int) -> Any:
        @wrap_model_call
        def choosing(request: Any, handler: Any) -> Any:
            kept = [t for t in request.tools if t.name != name or len(request.messages) < after]
            return handler(request.override(tools=kept))

        return choosing

    script = [calling(("search", {"query": "x"})), *map(calling, map(act, WAY))]
    result, events, bodies, _ = play(script, lambda ours: [ours, without("search", 3)], tools=[search])
    assert result.completed
    assert [len(body["tools"]) for body in bodies] == [4, 4, *[3] * 6]
    assert len([event for event in events if event["event"] == "head"]) == 2
    with pytest.raises(sp.InvalidArgumentError, match="removed observe"):
        play(script, lambda ours: [ours, without("observe", 0)])


def test_a_tool_that_the_provider_runs_is_refused_in_a_sentence():
    with pytest.raises(sp.InvalidArgumentError, match="'web_search' is run by the provider"):
        play([calling(act("A->C"))], lambda ours: [ours], tools=[{"type": "web_search"}])


# --- Models that fail ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("asynchronously", [False, True])
@pytest.mark.parametrize("inside", [False, True])
@pytest.mark.parametrize("on_failure", ["continue", "error"])
def test_a_model_failure_ends_the_episode_after_the_retries_that_were_asked_for(inside, asynchronously, on_failure):
    retry = ModelRetryMiddleware(max_retries=1, initial_delay=0.0, jitter=False, on_failure=on_failure)
    episode, events = fresh()
    with Broken([]) as stub, episode:
        ours, model = SmartPlayMiddleware(episode), client(stub)
        agent = create_agent(model, middleware=[ours, retry] if inside else [retry, ours])
        with invoking(agent, model, asynchronously) as invoke:
            if on_failure == "error":
                with pytest.raises(Exception, match="down"):
                    invoke({"messages": []})
            else:
                assert "failed after 2 attempts" in invoke({"messages": []})["messages"][-1].text
    assert stub.attempts == 2
    assert episode.result.end_reason == "player_error"
    assert re.search("Error code: 500 .*down", episode.result.error)
    assert "InternalServerError" in events[-1]["traceback"]
    assert sp.replay(events).identical


def test_after_a_failure_the_agent_may_be_invoked_again():
    episode, events = fresh()
    script = iter([*map(calling, map(act, WAY))])
    with Broken([]) as broken, OpenAIStub(script) as stub, episode:
        models = iter([client(broken), client(stub)])

        @wrap_model_call
        def choose(request: Any, handler: Any) -> Any:
            return handler(request.override(model=next(models, client(stub))))

        agent = create_agent(client(stub), middleware=[choose, SmartPlayMiddleware(episode)])
        with pytest.raises(Exception, match="down"):
            agent.invoke({"messages": []})
        agent.invoke({"messages": []})
    assert (episode.result.completed, episode.result.turns) == (True, 7)
    assert sp.replay(events).identical


def test_a_fallback_model_plays_where_it_is_outside_and_is_refused_inside():
    def run(inside: bool) -> sp.EpisodeResult:
        episode, _ = fresh()
        with Broken([]) as broken, OpenAIStub([*map(calling, map(act, WAY))]) as stub, episode:
            ours, fallback = SmartPlayMiddleware(episode), ModelFallbackMiddleware(client(stub))
            order = [ours, fallback] if inside else [fallback, ours]
            create_agent(client(broken), middleware=order).invoke({"messages": []})
        assert episode.result is not None
        return episode.result

    assert run(inside=False).completed
    with pytest.raises(sp.InvalidArgumentError, match="before SmartPlayMiddleware"):
        run(inside=True)


def test_replies_that_a_middleware_discards_are_charged_and_not_played():
    @wrap_model_call
    def twice(request: Any, handler: Any) -> Any:
        handler(request)
        return handler(request)

    episode, events = fresh()
    script = [message for short in WAY for message in (calling(act("B->A")), calling(act(short)))]
    with OpenAIStub(script, sp.Usage(prompt=10, reply=2)) as stub, episode:
        create_agent(client(stub), middleware=[SmartPlayMiddleware(episode), twice]).invoke({"messages": []})
    assert (episode.result.completed, episode.result.turns, episode.result.illegal_actions) == (True, 7, 0)
    assert len(stub.requests) == 14
    assert episode.result.tokens.provider.requests == 14
    assert sp.replay(events).identical


# --- People and limits between a reply and its calls --------------------------------------------------------------


def reviewed(order: Callable[[Any, Any], list[Any]], script: list[Any], **mode: Any):
    """An agent whose actions are reviewed; the decisions are sent one after the other."""
    episode, events = fresh()
    stub = OpenAIStub(script)
    model = client(stub)
    approval = {"act": {"allowed_decisions": ["approve", "edit", "reject", "respond"]}}
    human = HumanInTheLoopMiddleware(interrupt_on=approval, **mode)
    middleware = order(SmartPlayMiddleware(episode), human)
    agent = create_agent(model, middleware=middleware, checkpointer=InMemorySaver())
    return episode, events, stub, agent, model


ORDERS = [lambda ours, human: [ours, human], lambda ours, human: [human, ours]]


@pytest.mark.parametrize("asynchronously", [False, True])
@pytest.mark.parametrize("order", ORDERS)
def test_a_person_approves_edits_and_rejects_before_anything_is_played(order, asynchronously):
    script = [calling(act("A->C"), act("A->C"), act("C->B")), *[calling(say="Well.")] * 3]
    episode, events, stub, agent, model = reviewed(order, script)
    with stub, episode, invoking(agent, model, asynchronously) as invoke:
        state = invoke({"messages": []})
        assert len(state["__interrupt__"]) == 1
        assert episode.stats.steps == 0, "nothing is played before the person has decided"
        better = {"name": "act", "args": {"action": move("A->B")}}
        decisions = [
            {"type": "approve"},
            {"type": "edit", "edited_action": better},
            {"type": "reject", "message": "Not that one."},
        ]
        state = invoke(Command(resume={"decisions": decisions}))
    calls = sorted((event for event in events if event["event"] == "call"), key=lambda event: event["position"])
    assert [(event["arguments"], event.get("host")) for event in calls] == [
        (f'{{"action": "{move("A->C")}"}}', None),
        (f'{{"action": "{move("A->B")}"}}', "edited"),
        (f'{{"action": "{move("C->B")}"}}', "refused"),
    ]
    assert (episode.result.steps, episode.result.refused_calls) == (2, 1)
    assert sorted(message.status for message in results(state["messages"])) == ["error", "success", "success"]
    shown = stub.received[1].messages
    assert any(text_of(message).endswith("Not that one.") for message in shown if message["role"] == "tool")
    # Older versions of LangChain write no such note.
    noted = any("Executed instead: act" in message.text for message in results(state["messages"]))
    told = any("Executed instead: act" in text_of(message) for message in shown if message["role"] == "user")
    assert noted == told, "the model reads that its call was replaced"
    assert sp.replay(events).identical


@needs_single_approvals
@pytest.mark.parametrize("order", ORDERS)
def test_calls_that_are_approved_one_by_one_are_played_in_the_order_of_the_message(order):
    script = [calling(act("A->C"), ("observe", {}), act("A->B")), *[calling(say="Well.")] * 3]
    episode, events, stub, agent, _ = reviewed(order, script, interrupt_mode="per_call")
    with stub, episode:
        state = agent.invoke({"messages": []}, THREAD)
        first, second = state["__interrupt__"]
        assert {first.value["args"]["action"], second.value["args"]["action"]} == {move("A->C"), move("A->B")}
        later = next(each for each in (first, second) if each.value["args"]["action"] == move("A->B"))
        earlier = first if later is second else second
        state = agent.invoke(Command(resume={later.id: {"type": "approve"}}), THREAD)
        assert episode.stats.steps == 0, "the earlier call comes first"
        state = agent.invoke(Command(resume={earlier.id: {"type": "approve"}}), THREAD)
    played = [(event["position"], event["data"]["step"]) for event in events if event["event"] == "call"]
    assert played == [(0, 1), (1, 1), (2, 2)]
    contents = [message.text for message in results(state["messages"])]
    assert len(contents) == 3
    assert not any("waits for the decision" in content for content in contents)
    assert sp.replay(events).identical


def test_a_reviewer_cannot_turn_one_call_into_another():
    episode, _, stub, agent, _ = reviewed(ORDERS[0], [calling(act("A->C"))])
    with stub, episode:
        agent.invoke({"messages": []}, THREAD)
        other = {"type": "edit", "edited_action": {"name": "observe", "args": {}}}
        with pytest.raises(sp.InvalidArgumentError, match="changed into one of observe"):
            agent.invoke(Command(resume={"decisions": [other]}), THREAD)


@pytest.mark.parametrize("inside", [False, True])
def test_a_tool_call_limit_counts_calls_before_they_are_played(inside):
    limit = ToolCallLimitMiddleware(run_limit=2, exit_behavior="continue")
    script = [calling(act("A->C"), act("A->B"), act("C->B")), *[calling(say="Well.")] * 3]
    result, _, bodies, state = play(script, lambda ours: [ours, limit] if inside else [limit, ours])
    assert (result.steps, result.refused_calls) == (2, 1)
    assert [message.text for message in results(state) if message.status == "error"] == [
        "Tool call limit exceeded. Do not make additional tool calls."
    ]
    assert "limit exceeded" in text_of(bodies[1]["messages"][-1])


@pytest.mark.parametrize("inside", [False, True])
@pytest.mark.parametrize(
    ("limit", "calls", "counts", "detail"),
    [
        (ToolCallLimitMiddleware(run_limit=1, exit_behavior="end"), [(act("A->C"), act("A->B"))], (0, 2), "limit"),
        (
            ModelCallLimitMiddleware(run_limit=2, exit_behavior="end"),
            [(act(short),) for short in WAY],
            (2, 0),
            "Model call limits exceeded",
        ),
    ],
    ids=["calls of tools", "calls of the model"],
)
def test_a_limit_that_ends_the_run_ends_a_closed_episode_as_the_hosts(inside, limit, calls, counts, detail):
    script = [calling(*each) for each in calls]
    result, _, _, _ = play(script, lambda ours: [ours, limit] if inside else [limit, ours])
    assert (result.steps, result.refused_calls, result.end_reason) == (*counts, "host")
    assert detail in result.detail


def test_a_middleware_may_answer_in_the_games_place_and_may_not_change_its_results():
    @wrap_tool_call
    def refusing(request: Any, handler: Any) -> Any:
        if request.tool_call["name"] == "observe":
            return ToolMessage("Look yourself.", tool_call_id=request.tool_call["id"])
        return handler(request)

    @wrap_tool_call
    def hiding(request: Any, handler: Any) -> Any:
        return handler(request).model_copy(update={"content": "hidden"})

    script = [calling(("observe", {}), act("A->C")), *[calling(say="Well.")] * 3]
    for order in (lambda ours: [ours, refusing], lambda ours: [refusing, ours]):
        result, _, bodies, _ = play(script, order)
        assert (result.steps, result.refused_calls) == (1, 1)
        assert "Look yourself." in [text_of(message) for message in bodies[1]["messages"]]
    with pytest.raises(sp.InvalidArgumentError, match="changed the result of observe"):
        play(script, lambda ours: [ours, hiding])


class Impatient(AgentMiddleware):
    """The first call of a message comes late, and the second one is not waited for."""

    async def awrap_tool_call(self, request: Any, handler: Any) -> Any:
        if request.tool_call["id"] == "c0":
            await asyncio.sleep(0.5)
        if request.tool_call["id"] != "c1":
            return await handler(request)
        try:
            return await asyncio.wait_for(handler(request), 0.1)
        except TimeoutError:
            return ToolMessage("Error: This took too long.", tool_call_id=request.tool_call["id"])


@pytest.mark.parametrize("order", ORDERS)
def test_a_call_that_a_middleware_stops_waiting_for_holds_up_no_other(order):
    script = [calling(*map(act, ["A->C", "A->B", "C->B", "A->C"])), *[calling(say="Well.")] * 3]
    result, events, _, messages = play(script, lambda ours: order(ours, Impatient()), asynchronously=True)
    calls = [event for event in events if event["event"] == "call"]
    played = [(event["position"], event.get("host")) for event in calls]
    assert played == [(0, None), (1, "refused"), (2, None), (3, None)]
    assert (result.steps, result.refused_calls) == (3, 1)
    assert [message.text.split(".")[0] for message in results(messages)][1] == "Error: This took too long"


class TestAnAgentWithoutACheckpointer:
    def test_is_told_what_it_needs_to_go_on_after_an_error(self):
        model = ScriptedModel([calling(act(short)) for short in WAY[:3]])  # then it raises
        episode, _ = fresh()
        with episode:
            agent = create_agent(model, middleware=[SmartPlayMiddleware(episode)])
            with pytest.raises((RuntimeError, StopIteration)):
                agent.invoke({"messages": []})
            with pytest.raises(sp.InvalidArgumentError, match="without a checkpointer keeps nothing"):
                agent.invoke({"messages": []})
