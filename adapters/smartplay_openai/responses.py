"""The Responses interface, stateless: a prompt as input items, output items as a reply.

Nothing is stored at the provider (`store=False`), because what a model sees is decided here, turn by turn. A model's
reasoning then has to be handed back, encrypted, with the calls that it led to. The output items are therefore kept in
their order as the message's `provider_items`, and sent again as they came for as long as their turn is in the window.
Only the words of a message item are taken out, since they stand in the message itself and would be counted twice.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from smartplay_openai.answers import plain, read_usage
from smartplay_openai.wire import acceptable
from smartplay_tools import (
    BrokenAnswerError,
    Message,
    MessageToolCall,
    Prompt,
    Reply,
    assistant_message,
    calls_of,
    schema,
    text_of,
)

LEAST_LIMIT = 16
"""The interface refuses a smaller cap on the reply; a reply that uses the difference is recorded as an overrun."""


def request(prompt: Prompt, *, limit_field: str = "max_output_tokens") -> dict[str, Any]:
    """Return the keyword arguments of `client.responses.create`, but for the model."""
    items = [item for message in acceptable(prompt.messages) for item in _items(message)]
    arguments: dict[str, Any] = {"input": items, "store": False, "include": ["reasoning.encrypted_content"]}
    if prompt.tools:
        arguments["tools"] = [schema(tool, "responses") for tool in prompt.tools]
    if prompt.max_tokens is not None:
        arguments[limit_field] = max(prompt.max_tokens, LEAST_LIMIT)
    return arguments


def reply(response: Any) -> Reply:
    """Return the reply that a response holds; one without any raises `BrokenAnswerError`."""
    sent = plain(response)
    usage = read_usage(sent.get("usage"), "input", "output")
    output = sent.get("output")
    if sent.get("status") in ("failed", "cancelled") or not isinstance(output, list):
        problem = (sent.get("error") or {}).get("message") or "no output"
        raise BrokenAnswerError(f"The response failed: {problem}.", usage)
    return Reply(read_items([item for item in output if isinstance(item, Mapping)]), usage)


def read_items(items: Iterable[Mapping[str, Any]]) -> Message:
    """Return the message that output items make up; they stand in it as they came, but for the words."""
    texts, calls, kept = [], [], []
    for item in items:
        match item.get("type", "message"):
            case "message":
                texts.append(text_of({"content": item.get("content") or ""}))
                item = {**item, "type": "message", "content": []}
            case "function_call":
                function = {"name": item.get("name"), "arguments": item.get("arguments")}
                calls.append({"id": item.get("call_id"), "type": "function", "function": function})
        kept.append(item)
    return assistant_message(
        {"role": "assistant", "content": _content(texts), "tool_calls": calls, "provider_items": kept}
    )


def assemble(events: Iterable[Any]) -> dict[str, Any]:
    """Return the response that ends a stream of events; a stream that was cut raises `BrokenAnswerError`."""
    for event in events:
        if event.type in ("response.completed", "response.incomplete", "response.failed"):
            return plain(event.response)
        if event.type == "error":
            raise BrokenAnswerError(f"The stream failed: {event.message}.")
    raise BrokenAnswerError("The stream ended before the reply did.")


def stream_options() -> dict[str, Any]:
    """Return what makes a request a stream."""
    return {"stream": True}


def _content(texts: list[str]) -> str | list[dict[str, str]] | None:
    # A part for each message item, so that each gets its own words back.
    return [{"type": "text", "text": text} for text in texts] if len(texts) > 1 else "".join(texts) or None


def _items(message: Message) -> Iterator[dict[str, Any]]:
    if message["role"] == "tool":
        output = {"call_id": message.get("tool_call_id"), "output": text_of(message)}
        yield {"type": "function_call_output", **output}
    elif message["role"] == "assistant":
        yield from output_items(message)
    else:
        yield {"role": message["role"], "content": text_of(message)}


def output_items(message: Message) -> Iterator[dict[str, Any]]:
    """The items that an assistant message came from; for a message from elsewhere, items that say the same."""
    words, calls = _texts(message), iter(calls_of(message))
    for item in message.get("provider_items", ()):
        match item.get("type") if isinstance(item, Mapping) else None:
            case None:
                continue
            case "message":
                yield {**item, "content": _output_text(next(words, ""))}
            case "function_call":
                yield {**item, **_call(next(calls))}
            case _:
                yield dict(item)
    for text in words:
        yield {"type": "message", "role": "assistant", "content": _output_text(text)}
    for call in calls:
        yield {"type": "function_call", **_call(call)}


def _output_text(text: str) -> list[dict[str, Any]]:
    return [{"type": "output_text", "text": text, "annotations": []}]


def _call(call: MessageToolCall) -> dict[str, Any]:
    return {"call_id": call["id"], **call["function"]}


def _texts(message: Message) -> Iterator[str]:
    """The words of each message item; a message without calls has at least empty ones."""
    content = message["content"]
    if isinstance(content, list):
        yield from (text_of({"content": [part]}) for part in content)
    elif content or not calls_of(message):
        yield content or ""
