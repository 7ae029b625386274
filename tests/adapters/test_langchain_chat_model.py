"""PlayerChatModel: what an agent of LangChain's is told of a player, and what the player is told of the agent."""

from __future__ import annotations

import functools
import operator

import pytest
from langchain.agents import create_agent
from smartplay_langchain import PlayerChatModel, SmartPlayMiddleware
from smartplay_langchain.messages import usage_of

import smartplay_tools as sp
from tests.adapters.conformance import calling, fresh

pytestmark = pytest.mark.slow


async def test_an_agent_streams_its_events():
    episode, _ = fresh(sp.Budget(prompt_tokens=700))
    with episode:
        model = PlayerChatModel(player=sp.get_player("rule"))
        agent = create_agent(model, middleware=[SmartPlayMiddleware(episode)])
        # Streams of events have LangChain's own limit of 25 supersteps, not the agent's.
        streaming = agent.astream_events({"messages": []}, {"recursion_limit": 1000}, version="v2")
        events = [event async for event in streaming]
    kinds = [event["event"] for event in events]
    assert episode.result.completed
    turns = episode.result.turns
    assert (kinds.count("on_chat_model_start"), kinds.count("on_chat_model_end")) == (turns, turns)
    assert kinds.count("on_tool_start") == episode.result.tool_calls


def test_all_that_the_player_reports_arrives():
    usage = sp.Usage(prompt=90, reply=9, cached=40, written=30, written_1h=20, reasoning=7, cut=1)
    model = PlayerChatModel(player=sp.ScriptedPlayer([calling(say="I am"), calling(say="I am")], usage))
    assert usage_of(model.invoke("Go.")) == usage
    assert usage_of(functools.reduce(operator.add, model.stream("Go."))) == usage


def test_a_text_to_stop_at_is_refused_in_a_sentence():
    model = PlayerChatModel(player=sp.get_player("rule"))
    with pytest.raises(sp.InvalidArgumentError, match="leave `stop` out"):
        model.invoke("Go!", stop=["."])
    with pytest.raises(ValueError, match="leave `stop` out"):
        PlayerChatModel(player=model.player, stop=["."])
