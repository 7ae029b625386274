"""Chat completions, the server's side: requests read, completions and their streams written."""

from __future__ import annotations

import time
import uuid
from collections.abc import Iterator, Mapping
from typing import Any

from smartplay_openai.server.problems import bad, check_calls, read_limit, read_tool
from smartplay_tools import Message, Prompt, Usage
from smartplay_tools.messages import assistant_message, calls_of, text_of

ROLES = ("system", "developer", "user", "assistant", "tool")
PATH = "/v1/chat/completions"


def read(body: Mapping[str, Any]) -> Prompt:
    """Return the prompt that a request holds; a request that OpenAI would refuse raises `RequestError`."""
    messages = body.get("messages")
    if not isinstance(messages, list) or not messages:
        raise bad("messages is a list of at least one message.", "messages")
    if body.get("n") not in (None, 1):
        raise bad("This endpoint gives one choice: n is 1.", "n")
    canonical = [_message(message, f"messages[{at}]") for at, message in enumerate(messages)]
    check_calls(canonical, "messages")
    tools = body.get("tools") or []
    specs = tuple(read_tool(_function(tool), f"tools[{at}]") for at, tool in enumerate(tools))
    return Prompt(canonical, specs, read_limit(body, "max_completion_tokens", "max_tokens"))


def write(message: Message, model: str, usage: Usage) -> dict[str, Any]:
    """Return the completion that says a message."""
    extra = [item for item in message.get("provider_items", ()) if isinstance(item, Mapping) and "type" not in item]
    said: dict[str, Any] = {"role": "assistant", "content": text_of(message) or None, "refusal": None}
    for fields in extra:
        said.update(fields)
    if reasoning := message.get("reasoning_content"):
        said["reasoning_content"] = reasoning
    if calls := calls_of(message):
        said["tool_calls"] = [{**call, "id": f"call_{uuid.uuid4().hex[:24]}"} for call in calls]
    choice = {"index": 0, "message": said, "logprobs": None, "finish_reason": "tool_calls" if calls else "stop"}
    return {**_envelope("chat.completion", model), "choices": [choice], "usage": _usage(usage)}


def stream(completion: dict[str, Any], body: Mapping[str, Any]) -> Iterator[tuple[str | None, dict[str, Any] | str]]:
    """Yield a completion's chunks, as (event name, data): words and arguments in two pieces, so that readers add."""
    (choice,) = completion["choices"]
    envelope = {**completion, "object": "chat.completion.chunk", "usage": None}

    def chunk(delta: dict[str, Any], finish_reason: str | None = None) -> tuple[None, dict[str, Any]]:
        choices = [{"index": 0, "delta": delta, "logprobs": None, "finish_reason": finish_reason}]
        return None, {**envelope, "choices": choices}

    message = choice["message"]
    yield chunk({"role": "assistant", "content": None})
    for field, value in message.items():
        if field not in ("role", "tool_calls") and isinstance(value, str):
            for piece in halves(value):
                yield chunk({field: piece})
        elif field not in ("role", "tool_calls") and value is not None:
            yield chunk({field: value})
    for index, call in enumerate(message.get("tool_calls", ())):
        function = {"name": call["function"]["name"], "arguments": ""}
        yield chunk({"tool_calls": [{**call, "index": index, "function": function}]})
        for piece in halves(call["function"]["arguments"]):
            yield chunk({"tool_calls": [{"index": index, "function": {"arguments": piece}}]})
    yield chunk({}, choice["finish_reason"])
    if (body.get("stream_options") or {}).get("include_usage"):
        yield None, {**envelope, "choices": [], "usage": completion["usage"]}
    yield None, "[DONE]"


def halves(text: str) -> Iterator[str]:
    """Yield a text in two pieces that are not empty."""
    middle = (len(text) + 1) // 2
    yield from filter(None, (text[:middle], text[middle:]))


def _message(message: Any, param: str) -> Message:
    if not isinstance(message, Mapping) or message.get("role") not in ROLES:
        raise bad(f"A message has one of the roles {', '.join(ROLES)}.", param)
    if message.get("content") is None and message["role"] != "assistant":
        raise bad(f"A {message['role']} message has content.", param)
    try:
        text_of(message)
        if message["role"] == "assistant":
            said = assistant_message(message)
            if said["content"] is None and not calls_of(said):
                raise bad("An assistant message has content or tool calls.", param)
            return said
    except (AttributeError, TypeError, ValueError) as error:
        raise bad(f"The message cannot be read: {error}", param) from None
    fields = ("role", "content", "name", "tool_call_id")
    return {field: message[field] for field in fields if message.get(field) is not None}  # type: ignore[return-value]


def _function(tool: Any) -> Any:
    return tool.get("function") if isinstance(tool, Mapping) and tool.get("type") == "function" else None


def _envelope(kind: str, model: str) -> dict[str, Any]:
    return {"id": f"chatcmpl-{uuid.uuid4().hex}", "object": kind, "created": int(time.time()), "model": model}


def _usage(usage: Usage) -> dict[str, Any]:
    return {
        "prompt_tokens": usage.prompt,
        "completion_tokens": usage.reply,
        "total_tokens": usage.prompt + usage.reply,
        "prompt_tokens_details": {"cached_tokens": usage.cached},
        "completion_tokens_details": {"reasoning_tokens": usage.reasoning},
    }
