"""LangChain's own tests of chat models, for a player as a chat model.

Fourteen of them are skipped there. Players take and give text: no images (2), audio, PDF (2) and Anthropic's content
blocks, and no JSON mode. A player is an object: it has no environment variables, is not serialized, and no call
overrides its name (4). There is no network traffic to record, of which the time of a stream would be measured.
"""

from __future__ import annotations

import asyncio
import functools
import operator
from typing import Any

import pytest
from langchain.agents import create_agent
from langchain_tests.integration_tests import ChatModelIntegrationTests
from langchain_tests.unit_tests import ChatModelUnitTests
from smartplay_langchain import PlayerChatModel, SmartPlayMiddleware
from smartplay_langchain.messages import usage_of

import smartplay_tools as sp
from tests.adapters.conformance import calling, fresh

pytestmark = pytest.mark.slow


@pytest.fixture
def vcr() -> None:
    """What would record network traffic, of which there is none."""


class Obliging:
    """Calls the first tool with the plainest arguments, once, and else says something."""

    name = "obliging"

    def reply(self, prompt: sp.Prompt) -> sp.Reply:
        message: Any = {"role": "assistant", "content": "Hello, whoever you are."}
        if prompt.tools and prompt.messages[-1]["role"] != "tool":
            tool = prompt.tools[0]
            message = calling((tool.name, plainest(tool.parameters, tool.parameters)))
        return sp.Reply(message, sp.Usage(prompt=10, reply=5))

    async def areply(self, prompt: sp.Prompt) -> sp.Reply:
        await asyncio.sleep(0)
        return self.reply(prompt)


def plainest(schema: Any, root: Any) -> Any:
    if "$ref" in schema:
        return plainest(root["$defs"][schema["$ref"].split("/")[-1]], root)
    if "anyOf" in schema:
        return plainest(schema["anyOf"][0], root)
    match schema.get("type"):
        case "object":
            return {name: plainest(part, root) for name, part in schema.get("properties", {}).items()}
        case "array":
            return [plainest(schema["items"], root)]
        case "integer" | "number":
            return 3
        case "boolean":
            return True
    return schema.get("enum", ["你好 こんにちは"])[0]


class Player:
    @property
    def chat_model_class(self) -> type[PlayerChatModel]:
        return PlayerChatModel

    @property
    def chat_model_params(self) -> dict[str, Any]:
        return {"player": Obliging()}


class TestUnit(Player, ChatModelUnitTests): ...


class TestIntegration(Player, ChatModelIntegrationTests): ...


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
    assert kinds.count("on_chat_model_stream") > turns


def test_all_that_the_player_reports_arrives():
    usage = sp.Usage(prompt=90, reply=9, cached=40, written=30, written_1h=20, reasoning=7, cut=1)
    model = PlayerChatModel(player=sp.ScriptedPlayer([calling(say="I am"), calling(say="I am")], usage))
    assert usage_of(model.invoke("Go.")) == usage
    assert usage_of(functools.reduce(operator.add, model.stream("Go."))) == usage


def test_a_player_that_calls_no_tool_although_it_must_is_refused_in_a_sentence():
    model = PlayerChatModel(player=sp.ScriptedPlayer([{"role": "assistant", "content": "No."}]))
    with pytest.raises(sp.InvalidArgumentError, match="tool_choice demands"):
        model.bind_tools([{"name": "act", "description": "", "parameters": {}}], tool_choice="any").invoke("Go!")


def test_a_choice_restricts_what_the_player_is_shown():
    tools = [{"name": name, "description": "d", "parameters": {"type": "object", "properties": {}}} for name in "ab"]

    def shown(choice: Any) -> list[str]:
        player = sp.ScriptedPlayer([{"role": "assistant", "content": "", "tool_calls": [CALL]}])
        PlayerChatModel(player=player).bind_tools(tools, tool_choice=choice).invoke("Go!")
        return [tool.name for tool in player.prompts[0].tools]

    assert [shown(choice) for choice in ("auto", "any", "b", "none")] == [["a", "b"], ["a", "b"], ["b"], []]
    assert shown({"type": "function", "function": {"name": "b"}}) == ["b"]


CALL: Any = {"id": "c0", "type": "function", "function": {"name": "b", "arguments": "{}"}}
