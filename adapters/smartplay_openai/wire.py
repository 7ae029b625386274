"""What an OpenAI interface refuses, rewritten in requests only: impossible names of tools, and half characters.

Models behind compatible servers invent a tool called `go north!`, or stop in the middle of an emoji. The record keeps
what they said. A request that repeats it would be refused and the episode lost, so these are rewritten; everything else
is sent as it is in the prompt, call ids included, which the conversation has made unique.
"""

from __future__ import annotations

from collections.abc import Sequence

from smartplay_tools import Message
from smartplay_tools.types.message_forms import accepted_name, encodable
from smartplay_tools.types.messages import MessageToolCall


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
    name, arguments = accepted_name(call["function"]["name"]), encodable(call["function"]["arguments"])
    call_id: str = encodable(call.get("id") or "")
    return {"id": call_id, "type": "function", "function": {"name": name, "arguments": arguments}}
