"""Conversion of messages between Inspect's classes and the canonical chat form.

Inspect keeps the arguments of a call as an object. Arguments that are not an object are `{}` with the text in an error
message; the text is taken out of it here, so that a malformed call is counted as one. A reply's reasoning is recorded,
and goes back to the model with its turn, as the parts of Inspect's own message.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from inspect_ai.model import (
    ChatMessage,
    ChatMessageAssistant,
    ChatMessageSystem,
    ChatMessageTool,
    ChatMessageUser,
    Content,
    ContentImage,
    ContentReasoning,
    ContentText,
    ModelOutput,
    ModelUsage,
)
from inspect_ai.tool import ToolCall, ToolInfo, ToolParams

from smartplay_tools import InvalidArgumentError, Message, Reply, ToolSpec, Usage
from smartplay_tools.players import with_end
from smartplay_tools.players.conversion import (
    accepted_name,
    encodable,
    function_call,
    kept_item,
    reply_message,
    sendable,
    shown,
)
from smartplay_tools.types.arguments import object_in
from smartplay_tools.types.messages import calls_of, text_of
from smartplay_tools.types.pictures import NO_PICTURES, Picture

ITEM = "inspect_content"
"""The type of the provider item that holds the parts of a reply, where it is more than text."""

PARSE_ERROR = ("Error parsing the following tool call arguments:\n\n", "\n\nError details: ")
"""What Inspect writes before and after arguments that it could not parse."""


class InspectChat:
    """The messages of one conversation as Inspect's.

    A message that is shown again is the same object with the same id, as the log expects of a conversation.
    """

    def __init__(self, model: str) -> None:
        self._model = model
        self._written_messages: dict[str, ChatMessage] = {}
        self._functions: dict[str, str] = {}
        """The function of every call by the call's id."""

    def write(self, messages: Iterable[Message], pictures: Mapping[str, Picture] = NO_PICTURES) -> list[ChatMessage]:
        """Return messages as Inspect's; `pictures` are those that the messages name."""
        return [self._written(message, pictures) for message in messages]

    def remember(self, message: Message, sent: ChatMessageAssistant) -> None:
        """Have a reply go back to the model as Inspect's own message, with the calls that the prompt holds."""
        calls = [
            replace(call, id=new.id, function=new.function, arguments=new.arguments, parse_error=new.parse_error)
            for call, new in zip(sent.tool_calls or (), tool_calls(sendable(message)), strict=True)
        ]
        content: Any = encodable(sent.content)
        self._keep(message, sent.model_copy(update={"content": content, "tool_calls": calls or None}))

    def _written(self, message: Message, pictures: Mapping[str, Picture]) -> ChatMessage:
        return self._written_messages.get(_key(message)) or self._keep(message, self._new(message, pictures))

    def _keep(self, message: Message, written: ChatMessage) -> ChatMessage:
        self._functions |= {call["id"]: accepted_name(call["function"]["name"]) for call in calls_of(message)}
        self._written_messages[_key(message)] = written
        return written

    def _new(self, message: Message, pictures: Mapping[str, Picture]) -> ChatMessage:
        # What the record keeps as it was said may have what neither a request nor a log can hold.
        return to_inspect(sendable(message), self._functions, pictures, self._model)


def to_inspect(
    message: Message, functions: Mapping[str, str], pictures: Mapping[str, Picture] = NO_PICTURES, model: str = ""
) -> ChatMessage:
    """Return a message as Inspect's; `functions` are those of the calls so far by the calls' ids."""
    text = text_of(message)
    match message["role"]:
        case "system" | "developer":
            return ChatMessageSystem(content=text)
        case "user":
            return ChatMessageUser(content=shown(message, pictures, _text, _picture))
        case "tool":
            call_id = message["tool_call_id"]
            content = shown(message, pictures, _text, _picture)
            return ChatMessageTool(content=content, tool_call_id=call_id, function=functions.get(call_id))
    calls = [_written_call(call["id"], **call["function"]) for call in calls_of(message)]
    item = kept_item(message, ITEM)
    content = text if item is None else item["parts"]
    return ChatMessageAssistant(content=content, tool_calls=calls or None, source="generate", model=model)


def _text(text: str) -> Content:
    return ContentText(text=text)


def _picture(picture: Picture) -> Content:
    return ContentImage(image=picture.data_url)


def from_inspect(message: ChatMessage) -> Message:
    """Return one of Inspect's messages in canonical form; a picture in it is an `InvalidArgumentError`."""
    if isinstance(message.content, list) and any(isinstance(part, ContentImage) for part in message.content):
        raise InvalidArgumentError("The players of this package read words here; leave out observation and pictures.")
    match message:
        case ChatMessageAssistant():
            return _read_reply(message)
        case ChatMessageTool():
            return {"role": "tool", "content": message.text, "tool_call_id": message.tool_call_id or ""}
        case ChatMessageSystem():
            return {"role": "system", "content": message.text}
    return {"role": "user", "content": message.text}


def from_output(output: ModelOutput) -> Reply:
    """Return the reply that a model's output holds, with the usage that its provider reported."""
    return Reply(_read_reply(output.message), with_end(read_usage(output.usage), output.stop_reason))


def read_usage(usage: ModelUsage | None) -> Usage | None:
    """Return the provider's usage. Inspect's `input_tokens` are those outside of the provider's cache."""
    if usage is None:
        return None
    cached, written = usage.input_tokens_cache_read, usage.input_tokens_cache_write or 0
    return Usage(
        prompt=usage.input_tokens + (cached or 0) + written,
        reply=usage.output_tokens,
        cached=cached,
        written=written,
        reasoning=usage.reasoning_tokens or 0,
    ).checked(usage.total_tokens)


def tool_infos(tools: Iterable[ToolSpec]) -> list[ToolInfo]:
    """Return tools as Inspect describes them to a model."""
    return [
        ToolInfo(
            name=tool.name, description=tool.description, parameters=ToolParams.model_validate(dict(tool.parameters))
        )
        for tool in tools
    ]


def tool_specs(tools: Iterable[ToolInfo]) -> tuple[ToolSpec, ...]:
    """Return the tools that a model is shown, from Inspect's descriptions."""
    return tuple(ToolSpec(tool.name, tool.description, tool.parameters.model_dump(exclude_none=True)) for tool in tools)


def tool_calls(message: Message) -> list[ToolCall]:
    """Return the calls of a message as Inspect's."""
    return [_written_call(call.get("id", ""), **call["function"]) for call in calls_of(message)]


def _key(message: Message) -> str:
    return json.dumps(message, sort_keys=True)


def _written_call(call_id: str, name: str, arguments: str) -> ToolCall:
    value = object_in(arguments or "{}")
    if value is not None:
        return ToolCall(id=call_id, function=name, arguments=value)
    return ToolCall(id=call_id, function=name, arguments={}, parse_error=arguments)


def _read_reply(message: ChatMessageAssistant) -> Message:
    calls = [function_call(call.id, call.function, sent_arguments(call)) for call in message.tool_calls or ()]
    if isinstance(message.content, str):
        return reply_message(message.text, calls)
    parts: Sequence[Any] = message.content
    dumped = [part.model_dump(mode="json", exclude_none=True) for part in parts]
    reasoning = "".join(_visible(part) for part in parts if isinstance(part, ContentReasoning))
    return reply_message(message.text, calls, {"type": ITEM, "parts": dumped}, reasoning)


def _visible(part: ContentReasoning) -> str:
    return (part.summary or "") if part.redacted else part.reasoning


def sent_arguments(call: ToolCall) -> str:
    """The arguments as the model sent them, as far as Inspect has kept them."""
    if call.parse_error is None:
        return json.dumps(call.arguments, ensure_ascii=False)
    before, after = PARSE_ERROR
    if call.parse_error.startswith(before) and after in call.parse_error:
        return call.parse_error[len(before) :].rpartition(after)[0]
    return call.parse_error
