"""Anthropic's Messages interface as a scripted server."""

from __future__ import annotations

import json
from itertools import pairwise
from typing import Any

from smartplay_anthropic.codec import LIMIT

from smartplay_tools.context.prompts.wording import VERSION, Wording
from smartplay_tools.context.strategies.memory import memory_spec
from tests.adapters.conformance import MEMORY, Received
from tests.adapters.scripted_server import ScriptedServer
from tests.dialects.rules import DIALECTS
from tests.dialects.said import Turn, read_messages

USAGE = {"input_tokens": 5, "cache_read_input_tokens": 3, "cache_creation_input_tokens": 2, "output_tokens": 4}


class AnthropicStub(ScriptedServer):
    def say(self, path: str, body: dict[str, Any], message: Any) -> dict[str, Any]:
        blocks: list[dict[str, Any]] = [{"type": "text", "text": message["content"]}] if message["content"] else []
        for call in message.get("tool_calls", ()):
            function = call["function"]
            arguments = json.loads(function["arguments"])
            blocks.append({"type": "tool_use", "id": call["id"], "name": function["name"], "input": arguments})
        return {
            "id": "msg_1",
            "type": "message",
            "role": "assistant",
            "model": body["model"],
            "content": blocks,
            "stop_reason": "tool_use",
            "stop_sequence": None,
            "usage": USAGE,
        }

    def check(self, path: str, body: dict[str, Any]) -> None:
        assert path == "/v1/messages"
        turns = read_messages(body)
        assert all(before.role != turn.role for before, turn in pairwise([Turn("assistant"), *turns]))
        for rule in DIALECTS["Anthropic"].rules("refuses"):
            assert rule.act(turns, body, {}) is None, rule.rule

    def read(self, path: str, body: dict[str, Any]) -> Received:
        messages: list[dict[str, Any]] = [{"role": "system", "content": body["system"]}]
        for message in body["messages"]:
            blocks = blocks_of(message)
            words = [block["text"] for block in blocks if block["type"] == "text"]
            if message["role"] == "assistant":
                used = [block for block in blocks if block["type"] == "tool_use"]
                functions = [(b["id"], b["name"], json.dumps(b["input"], ensure_ascii=False)) for b in used]
                calls = [{"id": i, "function": {"name": name, "arguments": text}} for i, name, text in functions]
                messages.append({"role": "assistant", "content": "".join(words), "tool_calls": calls})
                continue
            messages.extend(
                {"role": "tool", "tool_call_id": block["tool_use_id"], "content": block["content"]}
                for block in blocks
                if block["type"] == "tool_result"
            )
            messages.extend({"role": "user", "content": text} for text in words)
        tools = [described(tool) for tool in body.get("tools", ())]
        # The interface wants a cap where the budget sets none.
        return Received(messages, tools, None if body["max_tokens"] == LIMIT else body["max_tokens"])


def blocks_of(message: dict[str, Any]) -> list[dict[str, Any]]:
    """The blocks of a message; a text alone is one."""
    content = message["content"]
    return [{"type": "text", "text": content}] if isinstance(content, str) else content


def described(tool: dict[str, Any]) -> tuple[str, str, Any]:
    """Name, description and schema of a tool; the provider knows those of its own by their type."""
    if tool.get("type") == "memory_20250818":
        assert tool == {"type": "memory_20250818", "name": "memory"}
        spec = memory_spec(MEMORY, Wording.of(VERSION))
        return spec.name, spec.description, spec.parameters
    return tool["name"], tool["description"], tool["input_schema"]
