"""LangChain: behaviour of toolkit, middleware and models that the common conversation does not test."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest
from langchain_core.messages import AIMessage, HumanMessage, SystemMessage, ToolMessage
from langchain_tests.integration_tests import ToolsIntegrationTests
from langchain_tests.unit_tests import ToolsUnitTests
from smartplay_langchain import (
    PlayerChatModel,
    SmartPlayToolkit,
    from_langchain,
    to_langchain,
    usage_of,
)
from smartplay_langchain.caching import messages_for

import smartplay_tools as sp
from smartplay_tools.players.conversion import function_call
from smartplay_tools.types.messages import text_of

pytestmark = pytest.mark.slow


def tools(**options: Any) -> dict[str, Any]:
    toolkit = SmartPlayToolkit(episode=sp.Episode("RockPaperScissorBasic-v0", seed=0, context="host", **options))
    return {tool.name: tool for tool in toolkit.get_tools()}


class Act:
    @property
    def tool_constructor(self):
        return tools()["act"]

    @property
    def tool_invoke_params_example(self):
        return {"action": "Rock"}


class TestActUnit(Act, ToolsUnitTests): ...


class TestActIntegration(Act, ToolsIntegrationTests): ...


class TestToolkit:
    def test_the_schema_is_ours_to_the_letter(self):
        made = tools()["act"]
        (spec,) = [tool for tool in made.episode.tools if tool.name == "act"]
        assert (made.description, made.args_schema) == (spec.description, spec.parameters)

    @pytest.mark.parametrize(
        "arguments", [{}, {"actoin": "Rock"}, {"action": True}, {"action": "Fly"}, {"self": 1, "config": 2}]
    )
    def test_a_mistake_is_an_error_with_its_artifact(self, arguments):
        call = {"type": "tool_call", "id": "c", "name": "act", "args": arguments}
        for message in (tools()["act"].invoke(call), asyncio.run(tools()["act"].ainvoke(call))):
            assert isinstance(message, ToolMessage)
            assert (message.status, message.artifact["is_error"]) == ("error", True)
            assert message.artifact["mistake"] in ("malformed", "illegal")
            assert message.content.startswith("Error: ")

    def test_the_model_sees_text_and_the_harness_sees_data(self):
        call = {"type": "tool_call", "id": "c", "name": "act", "args": {"action": "Rock"}}
        message = tools()["act"].invoke(call)
        assert message.status == "success"
        assert message.artifact["state_hash"]
        assert message.artifact["state_hash"] not in message.content


def test_usage_is_taken_over():
    usage = {
        "input_tokens": 9,
        "output_tokens": 4,
        "total_tokens": 13,
        "input_token_details": {"cache_read": 5},
        "output_token_details": {"reasoning": 2},
    }
    assert usage_of(AIMessage("", usage_metadata=usage)) == sp.Usage(prompt=9, reply=4, cached=5, reasoning=2)
    split = {"cache_creation": 0, "ephemeral_5m_input_tokens": 2, "ephemeral_1h_input_tokens": 1}
    kept = usage_of(AIMessage("", usage_metadata={**usage, "input_token_details": split}))
    assert kept == sp.Usage(prompt=9, reply=4, written=3, written_1h=1, reasoning=2)
    assert usage_of(AIMessage("")) is None


@pytest.mark.parametrize(
    ("metadata", "cut"),
    [
        pytest.param({"finish_reason": "length"}, 1, id="ChatOpenAI"),
        pytest.param({"incomplete_details": {"reason": "max_output_tokens"}}, 1, id="ChatOpenAI with Responses"),
        pytest.param({"stop_reason": "max_tokens"}, 1, id="ChatAnthropic"),
        pytest.param({"finish_reason": "MAX_TOKENS"}, 1, id="ChatGoogleGenerativeAI"),
        pytest.param({"stopReason": "max_tokens"}, 1, id="ChatBedrockConverse"),
        pytest.param({"done_reason": "length"}, 1, id="ChatOllama"),
        pytest.param({"finish_reason": "tool_calls", "incomplete_details": None}, 0, id="whole"),
        pytest.param({"incomplete_details": {"reason": "content_filter"}}, 0, id="filtered"),
    ],
)
def test_a_reply_that_was_cut_at_its_length_is_counted_as_one(metadata, cut):
    counts = {"input_tokens": 9, "output_tokens": 4, "total_tokens": 13}
    reply = AIMessage("I thi", response_metadata=metadata, usage_metadata=counts)
    refused = int("content_filter" in str(metadata))
    assert usage_of(reply) == sp.Usage(prompt=9, reply=4, cut=cut, refused=refused)
    without = AIMessage("I thi", response_metadata=metadata)
    assert usage_of(without) == (sp.Usage(cut=cut, refused=refused) if cut or refused else None)


def test_the_words_of_a_refusal_are_the_text_of_the_reply():
    assert text_of(from_langchain(AIMessage([{"type": "refusal", "refusal": "No."}]))) == "No."


THINKING = {"type": "thinking", "thinking": "Hm.", "signature": "s"}
WORDS = {"type": "text", "text": "..."}


@pytest.mark.parametrize("thought", [THINKING, {"type": "redacted_thinking", "data": "x"}, {"type": "reasoning"}])
def test_a_reply_that_was_cut_in_its_thoughts_goes_back_with_words_after_them(thought):
    """Providers refuse a reply that ends with its thoughts."""
    prompt = sp.Prompt([from_langchain(AIMessage([thought]))], ())
    (sent,) = messages_for(prompt, PlayerChatModel(player=sp.get_player("rule")), cache=False)
    assert sent.content == [thought, WORDS]


def test_names_of_tools_that_providers_refuse_are_rewritten_in_requests_alone():
    parts = [{"type": "tool_use", "id": "a", "name": "go north!", "input": {}}, {"type": "text", "text": "Go."}]
    names = ["go north!", "", "functions.act", "my.tool"]
    calls = [{"name": name, "args": {}, "id": f"{at}"} for at, name in enumerate(names)]
    reply = from_langchain(AIMessage(parts, tool_calls=calls))
    prompt = sp.Prompt([reply], (sp.ToolSpec("my.tool", "The host's own.", {"type": "object", "properties": {}}),))
    (sent,) = messages_for(prompt, PlayerChatModel(player=sp.get_player("rule")), cache=False)
    assert [call["name"] for call in sent.tool_calls] == ["go_north_", "_", "functions_act", "my.tool"]
    assert sent.content[0]["name"] == "go_north_"
    assert [call["function"]["name"] for call in reply["tool_calls"]] == names


def test_what_utf_8_or_json_cannot_hold_is_rewritten_in_requests_alone():
    reply: Any = {
        "role": "assistant",
        "content": "\ud83d",
        "tool_calls": [function_call("a", "act", '{"action": "\\ud83d", "times": 1e999}')],
    }
    messages = [reply, {"role": "tool", "tool_call_id": "a", "content": "\ud83d is not an action."}]
    model = PlayerChatModel(player=sp.get_player("rule"))
    call, result = messages_for(sp.Prompt(messages, ()), model, cache=False)
    assert (call.content, result.content) == ("\ufffd", "\ufffd is not an action.")
    assert call.tool_calls[0]["args"] == {"action": "\ufffd", "times": "inf"}
    assert to_langchain(messages)[0].content == "\ud83d"


def test_all_system_messages_become_one():
    head = [{"role": "system", "content": "a"}, {"role": "user", "content": "b"}, {"role": "system", "content": "c"}]
    assert [(type(m), m.content) for m in to_langchain(head)] == [(SystemMessage, "a\n\nc"), (HumanMessage, "b")]
