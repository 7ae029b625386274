"""Chat messages: one canonical form for what a model is sent and what it answers.

A message is a dictionary in the shape of OpenAI's chat completions, because that is what most people can read and
most servers take. Every adapter converts to it first, so one conversation has one count and one record everywhere.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Literal, NotRequired, Required, TypedDict

from smartplay_tools.arguments import as_text


class FunctionCall(TypedDict):
    """Name and arguments of a tool call; the arguments are JSON text, as the model wrote it."""

    name: str
    arguments: str


class MessageToolCall(TypedDict, total=False):
    """A tool call as it stands in an assistant message."""

    id: str
    type: Literal["function"]
    function: Required[FunctionCall]


class Message(TypedDict, total=False):
    """One chat message.

    `content` is text or a list of text parts. `provider_items` holds what a provider wants back unchanged, such as
    reasoning items: it is recorded and counted (its visible text), and stays out of the prompt's hash.
    """

    role: Required[Literal["system", "developer", "user", "assistant", "tool"]]
    content: Required[str | list[dict[str, Any]] | None]
    name: NotRequired[str]
    tool_calls: NotRequired[list[MessageToolCall]]
    tool_call_id: NotRequired[str]
    reasoning_content: NotRequired[str]
    provider_items: NotRequired[list[Any]]


def text_of(message: Mapping[str, Any]) -> str:
    """Return the text of a message, its parts joined. A part that is not text raises a ValueError."""
    content = message.get("content")
    if content is None or isinstance(content, str):
        return content or ""
    return "".join(map(_text_of_part, content))


def calls_of(message: Mapping[str, Any]) -> Sequence[MessageToolCall]:
    """Return the tool calls of a message, in the order in which it lists them."""
    return message.get("tool_calls") or ()


def reasoning_of(message: Mapping[str, Any]) -> str:
    """Return the visible text of a message's reasoning, in whichever field its provider keeps it."""
    text: str = message.get("reasoning_content") or ""
    items = message.get("provider_items")
    return text + "".join(_visible(items)) if items else text


def assistant_message(message: Mapping[str, Any]) -> Message:
    """Return an assistant message in canonical form, as a copy; a ValueError says what is not one.

    Fields that chat completions do not define become a provider item, so that nothing a model said is lost; null and
    empty fields, which client libraries add, are nothing that was said. Arguments become text.
    """
    if message.get("role") != "assistant":
        raise ValueError(f"A reply is a message with the role 'assistant', not {message.get('role')!r}.")
    text_of(message)  # refuses images
    canonical: Message = {"role": "assistant", "content": message.get("content")}
    if calls := message.get("tool_calls"):
        canonical["tool_calls"] = [_tool_call(call) for call in calls]
    if message.get("name"):
        canonical["name"] = message["name"]
    if message.get("reasoning_content"):
        canonical["reasoning_content"] = message["reasoning_content"]
    unknown = {key: value for key, value in message.items() if key not in Message.__annotations__ and value}
    if items := [*(message.get("provider_items") or ()), *([unknown] if unknown else ())]:
        canonical["provider_items"] = items
    return canonical


def _tool_call(call: Mapping[str, Any]) -> MessageToolCall:
    function = call.get("function") or {}
    arguments = as_text(function.get("arguments"))
    return {
        "id": str(call.get("id") or ""),
        "type": "function",
        "function": {"name": str(function.get("name") or ""), "arguments": arguments},
    }


def copy_of(message: Message) -> Message:
    """Return a copy that shares nothing that may be edited, but for the provider's items."""
    copy = message.copy()
    if isinstance(copy["content"], list):
        copy["content"] = [dict(part) if isinstance(part, dict) else part for part in copy["content"]]
    if "tool_calls" in copy:
        copy["tool_calls"] = [{**call, "function": {**call["function"]}} for call in copy["tool_calls"]]
    return copy


def _text_of_part(part: Any) -> str:
    if isinstance(part, str):
        return part
    for key in ("text", "refusal"):
        if isinstance(part, Mapping) and isinstance(part.get(key), str):
            return str(part[key])
    kind = part.get("type") if isinstance(part, Mapping) else type(part).__name__
    raise ValueError(f"Messages are text only here; a part of type {kind!r} cannot be counted.")


def _visible(item: Any) -> Iterator[str]:
    if isinstance(item, Mapping):
        for key, value in item.items():
            if key in ("text", "thinking") and isinstance(value, str):
                yield value
            elif key in ("summary", "content"):
                yield from _visible(value)
    elif isinstance(item, list):
        for part in item:
            yield from _visible(part)
