"""A request of the host's agent, as far as the window endpoint looks at it: call ids, results and tools."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from smartplay_openai.interface import Interface
from smartplay_tools import ToolSpec
from smartplay_tools.messages import text_of

NOT_IGNORED = {"model", "messages", "input", "tools", "stream", "stream_options", "store", "instructions"}
"""Fields of a request that the endpoint uses, or that are told of as messages."""


@dataclass(frozen=True)
class CompletionRequest:
    """What a request says.

    `results` are the tool results in it by call id, `body` its text, in which call ids are looked for wherever a
    framework may have put them: smolagents, for one, writes calls and results into the text of messages.
    """

    tools: Sequence[ToolSpec]
    results: Mapping[str, str]
    body: str
    ignored: str

    def holds(self, call_id: str) -> bool:
        """Whether the request mentions a call."""
        return call_id in self.body


def read_completion(interface: Interface, body: Mapping[str, Any]) -> CompletionRequest:
    """Read a request; one that OpenAI would refuse raises `RequestError`."""
    prompt = interface.read(body)
    results = {
        message.get("tool_call_id", ""): text_of(message) for message in prompt.messages if message["role"] == "tool"
    }
    return CompletionRequest(prompt.tools, results, json.dumps(body), _ignored(prompt.messages, body))


def _ignored(messages: Sequence[Mapping[str, Any]], body: Mapping[str, Any]) -> str:
    """Say what of a request does not reach the model."""
    characters: Counter[str] = Counter()
    for message in messages:
        if message["role"] in ("system", "developer", "user"):
            characters[message["role"]] += len(text_of(message))
    texts = [f"{role} messages ({count:,} characters)" for role, count in characters.items()]
    fields = sorted(field for field, value in body.items() if field not in NOT_IGNORED and value is not None)
    return ", ".join([*texts, *fields])
