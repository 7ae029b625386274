"""Conversion of prompts to requests of the Messages interface, and of answers to replies.

The interface has one system text, two alternating roles, and results as blocks of the next user message, with all
results of a turn together. A reply's thinking must be sent back with its turn, signed and in the same place. An answer
with more than text and calls is therefore kept block by block, and sent again unchanged.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

from smartplay_tools import Message, Prompt, Reply, schema
from smartplay_tools.players import plain_answer, read_usage, unreadable, with_end, with_management
from smartplay_tools.players.cache_marks import CacheMarks
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
from smartplay_tools.types.arguments import read
from smartplay_tools.types.messages import MessageToolCall, text_of
from smartplay_tools.types.pictures import Picture

ITEM = "anthropic_blocks"
"""The type of the provider item that holds an answer's blocks."""

LIMIT = 4096
"""The cap on a reply if the budget has none, because the interface requires one."""

UNMARKED = ("thinking", "redacted_thinking")
"""Types of blocks that cannot be marked."""

NOTHING = "..."
"""Stands for words where the interface wants some: an empty message, or one that ends with its thinking, is refused."""

LONGEST_NAME = 128
"""The most characters of a tool's name."""


def request(
    prompt: Prompt, *, limit: int = LIMIT, cache: CacheMarks = True, own: Mapping[str, Any] = MappingProxyType({})
) -> dict[str, Any]:
    """Return the keyword arguments of `client.messages.create`, except the model.

    `own` are further arguments, of which a cap on the reply applies where it is smaller than the prompt's.
    `cache` says what is marked for the provider's cache: the end of the prompt, and of the part that is unchanged since
    the previous prompt. "stable" marks that part alone, so that no write is paid for what changes at every call.
    """
    messages: list[dict[str, Any]] = []
    stable = 0
    """Blocks that come from the stable beginning of the prompt."""
    for number, message in enumerate(prompt.messages):
        match message["role"]:
            case "assistant":
                messages.append({"role": "assistant", "content": _assistant(message)})
            case "tool":
                content = _shown(message, prompt.pictures)
                call_id = message.get("tool_call_id", "")
                _add_to_user(messages, {"type": "tool_result", "tool_use_id": call_id, "content": content})
            case "user":
                content = _shown(message, prompt.pictures) or NOTHING
                for block in [_text_block(content)] if isinstance(content, str) else content:
                    _add_to_user(messages, block)
        if number + 1 == prompt.prefix_messages:
            stable = sum(len(sent["content"]) for sent in messages)
    # What the record keeps as it was said may have half a character, which a request cannot.
    messages = encodable(messages)
    arguments: dict[str, Any] = {"messages": messages, "max_tokens": limit}
    if (system := system_text(prompt.messages)) is not None:
        arguments["system"] = encodable(system)
    if prompt.tools:
        arguments["tools"] = [schema(tool, "anthropic") for tool in prompt.tools]
    arguments |= prompt.settings(own, no_tools={"type": "none"})
    # The system text comes first in a request; if a part of it is new, nothing after it is stable.
    if cache and not any(m["role"] in SYSTEM for m in prompt.messages[prompt.prefix_messages :]):
        _mark(messages, stable)
    if cache is True:
        _mark(messages, sum(len(sent["content"]) for sent in messages))
    return arguments


def _mark(messages: Sequence[dict[str, Any]], stable: int) -> None:
    """Mark the last of the first `stable` blocks that may be marked."""
    places = [(message["content"], at) for message in messages for at in range(len(message["content"]))]
    for blocks, at in reversed(places[:stable]):
        if blocks[at]["type"] not in UNMARKED:
            blocks[at] = {**blocks[at], "cache_control": {"type": "ephemeral"}}
            return


def reply(answer: Any) -> Reply:
    """Return the reply in an answer of the client; raise `BrokenAnswerError` if it cannot be read."""
    sent = plain_answer(answer)
    usage = read_usage(sent.get("usage"), "messages")
    blocks = _blocks(sent.get("content"), is_over=bool(sent.get("stop_reason")) and not sent.get("error"))
    if blocks is None:
        raise unreadable(sent, "The answer has no content blocks", usage)
    usage = with_management(with_end(usage, sent.get("stop_reason")), sent, blocks)
    calls = [_call(block) for block in blocks if block["type"] == "tool_use"]
    text = _joined(blocks, "text")
    if all(block["type"] in ("text", "tool_use") for block in blocks):
        return Reply(reply_message(text, calls), usage)
    item = {"type": ITEM, "blocks": [dict(block) for block in blocks]}
    return Reply(reply_message(text, calls, item, _joined(blocks, "thinking")), usage)


def _blocks(content: Any, *, is_over: bool) -> list[Mapping[str, Any]] | None:
    """The blocks of an answer, which gateways give as a text or as one block, or not at all if it is over."""
    if content is None and is_over:
        return []
    listed = [content] if isinstance(content, str | Mapping) else content
    if not isinstance(listed, list):
        return None
    blocks = [_text_block(block) if isinstance(block, str) else block for block in listed]
    return blocks if all(isinstance(block, Mapping) and "type" in block for block in blocks) else None


def _call(block: Mapping[str, Any]) -> MessageToolCall:
    """The call in a block; compatible servers leave out what the client does not miss."""
    given = block.get("input", "")  # gateways leave the JSON text that another interface has
    arguments = given if isinstance(given, str) else json.dumps(given, ensure_ascii=False)
    return function_call(block.get("id") or "", block.get("name") or "", arguments)


def _shown(message: Message, pictures: Mapping[str, Picture]) -> str | list[dict[str, Any]]:
    """The text of a message, or its blocks if it has pictures. A text block without a text would be refused."""
    content = shown(message, pictures, _text_block, _image_block)
    return content if isinstance(content, str) else [block for block in content if block.get("text") != ""]


def _text_block(text: str) -> dict[str, Any]:
    return {"type": "text", "text": text}


def _image_block(picture: Picture) -> dict[str, Any]:
    return {"type": "image", "source": {"type": "base64", "media_type": "image/png", "data": picture.base64}}


def _assistant(message: Message) -> list[dict[str, Any]]:
    """The blocks of an assistant message."""
    calls = [
        {
            "type": "tool_use",
            "id": call["id"],
            "name": accepted_name(call["function"]["name"], LONGEST_NAME),
            "input": json.loads(read(call["function"]["arguments"]).sent),
        }
        for call in message.get("tool_calls", ())
    ]
    if (kept := kept_item(message, ITEM)) is not None:
        again = iter(calls)
        blocks = [next(again) if block["type"] == "tool_use" else block for block in kept["blocks"]]
        blocks = [block for block in blocks if block["type"] != "text" or _words(block, "text").strip()]
        return blocks if blocks and blocks[-1]["type"] not in UNMARKED else [*blocks, _text_block(NOTHING)]
    text = text_of(message)
    words = [_text_block(text or NOTHING)] if text.strip() or not calls else []
    return words + calls


def _add_to_user(messages: list[dict[str, Any]], block: dict[str, Any]) -> None:
    if messages and messages[-1]["role"] == "user":
        messages[-1]["content"].append(block)
    else:
        messages.append({"role": "user", "content": [block]})


def _joined(blocks: Iterable[Mapping[str, Any]], kind: str) -> str:
    return "".join(_words(block, kind) for block in blocks if block["type"] == kind)


def _words(block: Mapping[str, Any], field: str) -> str:
    text = block.get(field)
    return text if isinstance(text, str) else ""
