"""The Agents SDK's own scripted model: a script as its steps, and what it was sent in canonical form."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from agents.testing import assistant_message, function_call
from smartplay_openai.responses import read_items

import smartplay_tools as sp


def step(message: sp.Message) -> list[Any]:
    words = [assistant_message(message["content"])] if message["content"] else []
    functions = [(call["id"], call["function"]) for call in message.get("tool_calls", ())]
    return words + [function_call(f["name"], f["arguments"], call_id=call_id) for call_id, f in functions]


def read(items: Sequence[Any]) -> list[dict[str, Any]]:
    """Read input items; all that stand between two others belong to one assistant message."""
    messages: list[dict[str, Any]] = []
    said: list[Any] = []
    for item in [*items, None]:
        kind = item and item.get("type", "message")
        if kind == "function_call" or (kind == "message" and item["role"] == "assistant"):
            said.append(item)
            continue
        if said:
            messages.append(dict(read_items(said)))
            said = []
        if kind == "function_call_output":
            messages.append({"role": "tool", "tool_call_id": item["call_id"], "content": item["output"]})
        elif kind == "message":
            messages.append({"role": item["role"], "content": item["content"]})
    return messages
