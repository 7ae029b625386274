"""Chat completions: a prompt as a request, a completion as a reply, a stream's chunks as a completion.

The canonical messages of `smartplay_tools` have this interface's own form, so little is left to do: leave out what is
ours, hand back what is the provider's, name the cap on the reply.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from smartplay_openai.answers import plain, read_usage
from smartplay_openai.wire import acceptable
from smartplay_tools import BrokenAnswerError, Message, Prompt, Reply, schema

NOT_SENT_BACK = {"annotations", "audio", "function_call"}
"""Fields of an answer that no request may hold."""


def request(prompt: Prompt, *, limit_field: str = "max_completion_tokens") -> dict[str, Any]:
    """Return the keyword arguments of `client.chat.completions.create`, but for the model.

    `limit_field` names the cap on the reply: older servers know `max_tokens` only.
    """
    arguments: dict[str, Any] = {"messages": [*map(_sent, acceptable(prompt.messages))]}
    if prompt.tools:
        arguments["tools"] = [schema(tool, "openai") for tool in prompt.tools]
    if prompt.max_tokens is not None:
        arguments[limit_field] = prompt.max_tokens
    return arguments


def reply(completion: Any) -> Reply:
    """Return the reply that a completion holds; one without any raises `BrokenAnswerError`."""
    sent = plain(completion)
    usage = read_usage(sent.get("usage"), "prompt", "completion")
    choices = sent.get("choices")
    choice = choices[0] if isinstance(choices, list) and choices else None
    message = choice.get("message") if isinstance(choice, Mapping) else None
    if not isinstance(message, Mapping):
        raise BrokenAnswerError("The completion has no choice with a message.", usage)
    return Reply(_received(message), usage)


def assemble(chunks: Iterable[Any]) -> dict[str, Any]:
    """Return the completion that a stream's chunks add up to; a stream that was cut raises `BrokenAnswerError`."""
    message: dict[str, Any] = {"role": "assistant", "content": None}
    calls: dict[int, dict[str, Any]] = {}
    usage, finished = None, False
    for chunk in map(plain, chunks):
        usage = chunk.get("usage") or usage
        # The chunk that holds the usage has no choices.
        for choice in chunk.get("choices") or ():
            finished = finished or bool(choice.get("finish_reason"))
            delta = choice.get("delta") or {}
            for part in delta.get("tool_calls") or ():
                _add_call(calls, part)
            _add_fields(message, delta)
    if not finished:
        raise BrokenAnswerError("The stream ended before the reply did.", read_usage(usage, "prompt", "completion"))
    if calls:
        message["tool_calls"] = [calls[index] for index in sorted(calls)]
    return {"choices": [{"message": message}], "usage": usage}


def stream_options() -> dict[str, Any]:
    """Return what makes a request a stream that ends with its usage."""
    return {"stream": True, "stream_options": {"include_usage": True}}


def _sent(message: Message) -> Mapping[str, Any]:
    if message["role"] != "assistant":
        return message
    sent: dict[str, Any] = {}
    for item in message.get("provider_items", ()):
        # What other interfaces keep there has a type; what this one does not know is a field of the message.
        if isinstance(item, Mapping) and "type" not in item:
            sent.update({field: value for field, value in item.items() if field not in NOT_SENT_BACK})
    sent.update({field: value for field, value in message.items() if field != "provider_items"})
    if sent["content"] is None and "tool_calls" not in sent:
        sent["content"] = ""
    return sent


def _received(message: Mapping[str, Any]) -> Message:
    received = {**message, "role": "assistant"}
    if isinstance(received.get("reasoning"), str):
        # The younger name of the same field.
        received["reasoning_content"] = received.pop("reasoning")
    return received  # type: ignore[return-value]


def _add_call(calls: dict[int, dict[str, Any]], part: Mapping[str, Any]) -> None:
    index = part.get("index")
    if not isinstance(index, int):
        # Some servers leave the index out; an id then begins a new call.
        index = len(calls) if part.get("id") or not calls else len(calls) - 1
    call = calls.setdefault(index, {"id": "", "type": "function", "function": {"name": "", "arguments": ""}})
    call["id"] = call["id"] or part.get("id") or ""
    for key, value in (part.get("function") or {}).items():
        if isinstance(value, str):
            call["function"][key] = call["function"].get(key, "") + value


def _add_fields(message: dict[str, Any], delta: Mapping[str, Any]) -> None:
    for field, value in delta.items():
        if field in ("role", "tool_calls") or value is None:
            continue
        known = message.get(field)
        both_add = isinstance(known, str | list) and type(known) is type(value)
        message[field] = known + value if both_add else value
