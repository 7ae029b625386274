"""What an OpenAI interface refuses, rewritten in requests only: impossible names of tools, and half characters.

Models behind compatible servers invent a tool called `go north!`, or stop in the middle of an emoji. The record keeps
what they said. A request that repeats it would be refused and the episode lost, so these are rewritten; everything else
is sent as it is in the prompt, call ids included, which the conversation has made unique.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from smartplay_tools import Message
from smartplay_tools.message_forms import encodable
from smartplay_tools.messages import MessageToolCall

NAME = re.compile(r"[A-Za-z0-9_-]{1,64}")
"""The format of a tool's name."""


def acceptable(messages: Sequence[Message]) -> list[Message]:
    """Return the messages with tool names that the interface takes, and without half characters."""
    sent: list[Message] = []
    for message in messages:
        copy = message.copy()
        for field, value in message.items():
            if not (isinstance(value, str) and value.isascii()) and field != "tool_calls":
                copy[field] = encodable(value)  # type: ignore[literal-required]
        if message.get("tool_calls"):
            copy["tool_calls"] = [_call(call) for call in message["tool_calls"]]
        sent.append(copy)
    return sent


def _call(call: MessageToolCall) -> MessageToolCall:
    name, arguments = call["function"]["name"], encodable(call["function"]["arguments"])
    if not NAME.fullmatch(name):
        name = re.sub(r"[^A-Za-z0-9_-]", "_", name)[:64] or "_"
    call_id: str = encodable(call.get("id") or "")
    return {"id": call_id, "type": "function", "function": {"name": name, "arguments": arguments}}
