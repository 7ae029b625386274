"""What a server received is what the record says was sent: for agents of frameworks, with their real clients."""

from __future__ import annotations

from typing import Any

import smartplay_tools as sp
from smartplay_tools.context.tokens import TokenCounter
from smartplay_tools.records.prompts import sent_prompts
from smartplay_tools.types.messages import text_of
from tests.adapters.conformance import one_system
from tests.adapters.openai_stub import OpenAIStub


def as_recorded(events: list[Any], stub: OpenAIStub) -> None:
    """Every request has the texts and tools of its prompt, and the tokens on record. The record replays."""
    counter = TokenCounter()
    counted = {event["sha256"]: event["tokens"] for event in events if "sha256" in event and "tokens" in event}
    for sent, received in zip(sent_prompts(events), stub.received, strict=True):
        prompt = sent.prompt
        assert sent.sha256 == sent.recorded_sha256
        assert texts(received.messages) == texts(prompt.messages)
        assert [name for name, _, _ in received.tools] == [tool.name for tool in prompt.tools]
        assert counter.prompt(prompt.messages, [sp.ToolSpec(*tool) for tool in received.tools]) == counted[sent.sha256]
    assert sp.replay(events).identical


def texts(messages: Any) -> list[str]:
    return [text_of(message) for message in one_system([dict(message) for message in messages])]
