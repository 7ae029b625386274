"""Conversion of messages between LangChain's classes and the canonical chat form.

LangChain sorts a reply's calls into `tool_calls`, whose arguments it could parse, and `invalid_tool_calls`, kept as
text; here both are calls, the valid ones first. Other parts of a reply (thinking and its signatures, for example) are
recorded and sent back to the model with their turn.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any

from langchain_core.messages import (
    AIMessage,
    AnyMessage,
    BaseMessage,
    HumanMessage,
    InvalidToolCall,
    SystemMessage,
    ToolCall,
    ToolMessage,
)
from langchain_core.messages.ai import UsageMetadata

from smartplay_tools import Message, Usage
from smartplay_tools.players import with_end, with_management
from smartplay_tools.players.conversion import (
    SYSTEM,
    accepted_name,
    encodable,
    function_call,
    kept_item,
    reply_message,
    shown,
    system_text,
)
from smartplay_tools.providers.tables import names
from smartplay_tools.types.arguments import object_in
from smartplay_tools.types.messages import MessageToolCall, text_of
from smartplay_tools.types.pictures import NO_PICTURES, Picture

ITEM = "langchain_message"
"""The type of the provider item that holds the parts of a reply other than text and calls."""

SENT = ("content", "additional_kwargs", "tool_calls", "invalid_tool_calls")
"""The fields of a message whose values reach a provider."""

THOUGHTS = ("thinking", "redacted_thinking", "reasoning")
"""The types of parts that are thoughts."""

NOTHING = "..."
"""Stands for the words of a reply that has none."""

CALL_PARTS = {"tool_use": "id", "function_call": "call_id"}
"""The types of parts that are calls, at Anthropic and OpenAI, with the name of the field that has the call's id."""


CALLS = frozenset({*CALL_PARTS, "tool_call", "invalid_tool_call"})
"""The types of calls, among the parts of a reply and of LangChain's own."""


def to_langchain(messages: Iterable[Message], pictures: Mapping[str, Picture] = NO_PICTURES) -> list[AnyMessage]:
    """Return a prompt's messages as LangChain's, with all system messages joined into one at the beginning.

    Half of the providers accept a single system text, and their LangChain packages refuse a second one. `pictures` are
    those that the messages name, which become image blocks.
    """
    messages = list(messages)
    system = system_text(messages)
    head: list[AnyMessage] = [] if system is None else [SystemMessage(system)]
    others = [message for message in messages if message["role"] not in SYSTEM]
    return head + [_to_langchain(message, pictures) for message in others]


def sendable(message: AnyMessage, tools: Collection[str]) -> AnyMessage:
    """Return a message of a prompt as providers take it; `tools` are the names of the prompt's tools.

    It has no half characters, and no names of tools that cannot be, which models invent. Anthropic and OpenAI refuse a
    reply that ends with its thoughts, as one does that was cut in them, so that words follow.
    """
    fields = {name: encodable(value) for name in SENT if (value := getattr(message, name, None))}
    for name in ("content", "tool_calls", "invalid_tool_calls"):
        if isinstance(fields.get(name), list):
            fields[name] = [_with_a_name(part, tools) for part in fields[name]]
    parts, calls = fields.get("content"), fields.get("tool_calls") or fields.get("invalid_tool_calls")
    if isinstance(parts, list) and not calls and isinstance(parts[-1], dict) and parts[-1].get("type") in THOUGHTS:
        fields["content"] = [*parts, _text_block(NOTHING)]
    changed = {name: value for name, value in fields.items() if value != getattr(message, name)}
    sent: AnyMessage = message.model_copy(update=changed) if changed else message
    return sent


def _with_a_name(part: Any, tools: Collection[str]) -> Any:
    """Return a part of a message; a call of a tool that is none has a name that providers take."""
    if not isinstance(part, dict) or part.get("type") not in CALLS or part.get("name") in tools:
        return part
    return {**part, "name": accepted_name(part.get("name") or "")}


def from_langchain(message: BaseMessage) -> Message:
    """Return a LangChain message in canonical form."""
    match message:
        case AIMessage():
            return _from_reply(message)
        case ToolMessage():
            return {"role": "tool", "content": _content(message), "tool_call_id": message.tool_call_id}
        case SystemMessage():
            return {"role": "system", "content": _content(message)}
    return {"role": "user", "content": _content(message)}


def usage_of(message: AIMessage) -> Usage | None:
    """Return the usage that the provider reported with a reply, and why it ended."""
    usage = message.usage_metadata
    if usage is None:
        return with_management(with_end(None, *_reasons(message)), message.response_metadata, message.content)
    parts: Mapping[str, Any] = usage.get("input_token_details", {})
    # Anthropic's writes are split by how long they are kept, and its sum is then 0.
    short, written_1h = (parts.get(f"ephemeral_{kept}_input_tokens") or 0 for kept in ("5m", "1h"))
    read = Usage(
        prompt=usage["input_tokens"],
        reply=usage["output_tokens"],
        cached=parts.get("cache_read"),
        written=parts.get("cache_creation") or short + written_1h,
        written_1h=written_1h,
        reasoning=usage.get("output_token_details", {}).get("reasoning") or 0,
    )
    ended = with_end(read.checked(usage["total_tokens"]), *_reasons(message))
    return with_management(ended, message.response_metadata, message.content)


def usage_metadata_of(usage: Usage) -> UsageMetadata:
    """Return a player's usage as LangChain's."""
    details: Any = {  # the last is Anthropic's alone
        "cache_read": usage.cached or 0,
        "cache_creation": usage.written,
        "ephemeral_1h_input_tokens": usage.written_1h,
    }
    return {
        "input_tokens": usage.prompt,
        "output_tokens": usage.reply,
        "total_tokens": usage.prompt + usage.reply,
        "input_token_details": details,
        "output_token_details": {"reasoning": usage.reasoning},
    }


def _reasons(message: AIMessage) -> Iterator[Any]:
    """Why a reply ended, wherever its provider says so."""
    metadata = message.response_metadata
    details = metadata.get("incomplete_details")  # of OpenAI's Responses
    yield details.get("reason") if isinstance(details, Mapping) else None
    yield from map(metadata.get, names("end_fields"))
    yield "refusal" if message.additional_kwargs.get("refusal") else None


def _to_langchain(message: Message, pictures: Mapping[str, Picture]) -> AnyMessage:
    text = text_of(message)
    match message["role"]:
        case "user":
            return HumanMessage(shown(message, pictures, _text_block, image_block))
        case "tool":
            content = shown(message, pictures, _text_block, image_block)
            return ToolMessage(content, tool_call_id=message.get("tool_call_id", ""))
    valid: list[ToolCall] = []
    invalid: list[InvalidToolCall] = []
    for call in message.get("tool_calls", ()):
        name, sent = call["function"]["name"], call["function"]["arguments"]
        arguments = object_in(sent or "{}")
        if arguments is None:  # LangChain keeps them as text
            invalid.append(InvalidToolCall(name=name, args=sent, id=call["id"], error=None, type="invalid_tool_call"))
        else:
            valid.append(ToolCall(name=name, args=arguments, id=call["id"], type="tool_call"))
    item = kept_item(message, ITEM) or {}
    kept = {"content": text, **item.get("message", {})}
    pairs = zip(item.get("call_ids", item.get("calls", ())), message.get("tool_calls", ()), strict=False)
    kept["content"] = _with_calls(kept["content"], pairs)
    return AIMessage(**kept, tool_calls=valid, invalid_tool_calls=invalid)


def _text_block(text: str) -> str | dict[Any, Any]:
    return {"type": "text", "text": text}


def image_block(picture: Picture) -> dict[str, Any]:
    """Return a picture as LangChain's content block for images, which the packages of providers translate."""
    return {"type": "image", "base64": picture.base64, "mime_type": "image/png"}


def _with_calls(content: Any, sent: Iterable[tuple[str, MessageToolCall]]) -> Any:
    """Return the content of a reply with its calls as a prompt holds them, given pairs of an id as sent and a call.

    Providers' packages compare the calls among the parts of a reply with its `tool_calls`: they send both if ids
    differ, and some send the arguments of the parts.
    """
    if not isinstance(content, list):
        return content
    left: dict[str, list[MessageToolCall]] = {}
    for call_id, call in sent:
        left.setdefault(call_id, []).append(call)

    def part_with_call(part: Any) -> Any:
        field = CALL_PARTS.get(part.get("type", "")) if isinstance(part, dict) else None
        calls = left.get(part.get(field, "")) if field else None
        if not field or not calls:
            return part
        call = calls.pop(0)
        text = call["function"]["arguments"]
        arguments = {"arguments": text} if "arguments" in part else {"input": object_in(text) or {}}
        return {**part, field: call["id"], **arguments}

    return [part_with_call(part) for part in content]


def _from_reply(reply: AIMessage) -> Message:
    calls: Sequence[ToolCall | InvalidToolCall] = [*reply.tool_calls, *reply.invalid_tool_calls]
    listed = [function_call(call["id"] or "", call["name"] or "", call["args"]) for call in calls]
    if isinstance(reply.content, str) and not reply.additional_kwargs:
        return reply_message(_words(reply), listed)
    kept = reply.model_dump(mode="json", include={"content", "additional_kwargs"})
    kept["response_metadata"] = {k: v for k, v in reply.response_metadata.items() if k == "model_provider"}
    sent = {"call_ids": [call["id"] or "" for call in calls]} if calls else {}
    blocks = [block for block in reply.content_blocks if block["type"] == "reasoning"]
    reasoning = "".join(str(block.get("reasoning", "")) for block in blocks)
    return reply_message(_words(reply), listed, {"type": ITEM, "message": kept, **sent}, reasoning)


def _words(reply: AIMessage) -> str:
    """The text of a reply; the words of a refusal are its text, too, wherever the provider's package keeps them."""
    parts = [reply.content] if isinstance(reply.content, str) else reply.content
    text = "".join(part if isinstance(part, str) else _text_of_part(part) for part in parts)
    return text or str(reply.additional_kwargs.get("refusal") or "")


def _text_of_part(part: dict[Any, Any]) -> str:
    return next((str(part[kind]) for kind in ("text", "refusal") if part.get("type") == kind and part.get(kind)), "")


def _content(message: BaseMessage) -> str | list[dict[str, Any]]:
    if isinstance(message.content, str):
        return message.content
    return [{"type": "text", "text": part} if isinstance(part, str) else part for part in message.content]
