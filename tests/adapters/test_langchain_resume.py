"""An agent goes on in another process: the graph from its checkpoint, the episode from its record."""

from __future__ import annotations

from typing import Any

import pytest
from langchain.agents import create_agent
from langchain.agents.middleware import HumanInTheLoopMiddleware, dynamic_prompt
from langchain_core.messages import HumanMessage, ToolMessage
from langgraph.checkpoint.memory import InMemorySaver
from langgraph.types import Command
from smartplay_langchain import SmartPlayMiddleware

import smartplay_tools as sp
from tests.adapters.conformance import GAME, SEED, WAY, act, calling, move
from tests.adapters.scripted_langchain import ScriptedModel, needs_single_approvals

pytestmark = pytest.mark.slow

THREAD = {"configurable": {"thread_id": "1"}}


Record = list[Any]


def begin(record: Record, model: Any, saver: Any, *others: Any) -> Any:
    episode = sp.Episode(GAME, seed=SEED, transcript=record)
    return create_agent(model, middleware=[SmartPlayMiddleware(episode), *others], checkpointer=saver)


def resumed(record: Record) -> tuple[Any, Record]:
    """The episode as it stands in its record, and its new record."""
    new: Record = []
    return sp.resume(list(record), transcript=new, session=True), new


def go_on(record: Record, model: Any, saver: Any, sent: Any, *others: Any) -> tuple[sp.Episode, Any, Record]:
    episode, new = resumed(record)
    with episode:
        middleware = [SmartPlayMiddleware(episode.conversation), *others]
        state = create_agent(model, middleware=middleware, checkpointer=saver).invoke(sent, THREAD)
    return episode.episode, state, new


def completed(episode: sp.Episode, state: Any, record: Record, turns: int = 7) -> None:
    assert (episode.result.completed, episode.result.turns, episode.result.steps) == (True, turns, 7)
    assert sp.replay(record).identical
    answered = [message.tool_call_id for message in state["messages"] if isinstance(message, ToolMessage)]
    asked = [call["id"] for message in state["messages"] for call in getattr(message, "tool_calls", ())]
    assert answered == asked, "the state has every call and its result once"


def test_an_approval_in_another_process():
    record, saver = [], InMemorySaver()
    human = HumanInTheLoopMiddleware(interrupt_on={"act": True})
    agent = begin(record, ScriptedModel([calling(act(WAY[0]))]), saver, human)
    assert "__interrupt__" in agent.invoke({"messages": []}, THREAD)
    approve = Command(resume={"decisions": [{"type": "approve"}]})
    model = ScriptedModel([*map(calling, map(act, WAY[1:]))])
    for _ in range(6):
        episode, record = resumed(record)
        middleware = [SmartPlayMiddleware(episode.conversation), human]
        state = create_agent(model, middleware=middleware, checkpointer=saver).invoke(approve, THREAD)
        assert "__interrupt__" in state
    episode, state, record = go_on(record, model, saver, approve, human)
    completed(episode, state, record)


def test_the_head_and_the_words_of_the_host_are_those_of_the_record():
    record, saver = [], InMemorySaver()

    @dynamic_prompt
    def polite(request: Any) -> str:
        return "Be polite."

    agent = begin(record, ScriptedModel([calling(act(WAY[0]))]), saver, polite)
    with pytest.raises(Exception, match="StopIteration"):
        agent.invoke({"messages": [HumanMessage("Play!")]}, THREAD)
    model = ScriptedModel([*map(calling, map(act, WAY[1:]))])
    episode, state, record = go_on(record, model, saver, None, polite)
    completed(episode, state, record)
    events = record
    assert len([event for event in events if event["event"] == "head"]) == 1
    assert not [event for event in events if event["event"] == "message" and event["by"] == "host"]


def test_another_thread_is_refused_in_a_sentence():
    record, saver = [], InMemorySaver()
    script = [*map(calling, map(act, WAY[:3]))]
    with pytest.raises(Exception, match="StopIteration"):
        begin(record, ScriptedModel(script), saver).invoke({"messages": []}, THREAD)
    with pytest.raises(sp.InvalidArgumentError, match="the thread on which the episode is played"):
        go_on(record, ScriptedModel([]), InMemorySaver(), {"messages": []})


@pytest.mark.parametrize(("node", "lacks"), [("tools", "lacks 2 of"), ("model", "lacks 3 of")])
def test_a_checkpoint_that_is_older_than_the_record_is_refused_in_a_sentence(node, lacks):
    """As a killed process leaves one: LangGraph writes checkpoints behind the run without `durability="sync"`."""
    record, saver = [], InMemorySaver()
    agent = begin(record, ScriptedModel([*map(calling, map(act, WAY[:3]))]), saver)
    with pytest.raises(Exception, match="StopIteration"):
        agent.invoke({"messages": []}, THREAD)
    *_, first = (one for one in agent.get_state_history(THREAD) if one.next == (node,))
    episode, _ = resumed(record)
    again = create_agent(ScriptedModel([]), middleware=[SmartPlayMiddleware(episode.conversation)], checkpointer=saver)
    with episode, pytest.raises(sp.InvalidArgumentError, match=f'{lacks}.*durability="sync"'):
        again.invoke(None, first.config)


@needs_single_approvals
def test_a_reviewed_and_held_call_is_played_in_another_process():
    record, saver = [], InMemorySaver()
    gate = {"act": {"allowed_decisions": ["approve"], "when": lambda request: move("A->C") in str(request.tool_call)}}
    human = HumanInTheLoopMiddleware(interrupt_on=gate, interrupt_mode="per_call")
    model = ScriptedModel([calling(act("A->C"), act("A->B"))])
    assert "__interrupt__" in begin(record, model, saver, human).invoke({"messages": []}, THREAD)
    rest = ScriptedModel([*[calling(say="Well.")] * 3])
    episode, state, record = go_on(record, rest, saver, Command(resume={"type": "approve"}), human)
    assert episode.result.steps == 2
    assert not any("waits for the decision" in message.text for message in state["messages"])
    assert sp.replay(record).identical
