"""A model that refuses says so in a field or a part of its own; every adapter reads these words as the reply's text."""

from __future__ import annotations

from typing import Any

import pytest
import smartplay_openai as so

import smartplay_tools as sp
from smartplay_tools.context.tokens import TokenCounter
from smartplay_tools.players.wire.responses import read_items
from smartplay_tools.types.messages import text_of
from tests.adapters.openai_stub import OpenAIStub

WORDS = "I will not play."
PART = {"type": "refusal", "refusal": WORDS}


def chat_completion() -> sp.Message:
    message = {"role": "assistant", "content": None, "refusal": WORDS}
    return so.chat_reply({"choices": [{"message": message}]}).message


def response() -> sp.Message:
    item = {"type": "message", "id": "m", "role": "assistant", "content": [PART]}
    return so.responses_reply({"output": [item]}).message


def output_items() -> sp.Message:
    return read_items([{"type": "message", "id": "m", "role": "assistant", "content": [PART]}])


def langchain_parts() -> sp.Message:
    from langchain_core.messages import AIMessage
    from smartplay_langchain import from_langchain

    return from_langchain(AIMessage([PART]))


def langchain_client() -> sp.Message:
    from smartplay_langchain import from_langchain

    client = pytest.importorskip("langchain_openai").ChatOpenAI
    with OpenAIStub([{"role": "assistant", "content": None, "refusal": WORDS}]) as stub:
        model = client(model="m", base_url=stub.base_url, api_key="none", max_retries=0)
        tool = {"name": "t", "description": "d", "parameters": {"type": "object", "properties": {}}}
        return from_langchain(model.bind_tools([tool]).invoke("Play!"))


@pytest.mark.parametrize(
    "read",
    [
        chat_completion,
        response,
        output_items,
        *(pytest.param(read, marks=pytest.mark.slow) for read in (langchain_parts, langchain_client)),
    ],
)
def test_the_words_of_a_refusal_are_the_text_of_the_reply(read: Any) -> None:
    message = read()
    assert text_of(message) == WORDS
    assert TokenCounter().message(message) >= TokenCounter().message({"role": "assistant", "content": WORDS})
