"""Conversion of messages: the steps that adapters share between the canonical form and that of their framework.

Replies are converted to the canonical form of `types.messages`. Messages of a prompt are converted after they have been
counted and recorded: a request cannot hold half a character or a tool by an impossible name, both of which a record
keeps as the model said them. Some interfaces refuse pictures in the results of tools: the lines that
`with_pictures_below` adds around them belong to the interface, like those of a chat template, and are neither recorded
nor counted.
"""

from __future__ import annotations

import functools
import json
import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any, TypeVar, cast

from smartplay_tools.context.prompts.wording import VERSION, Wording, in_any_version
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.providers.request_limits import most, shortened
from smartplay_tools.types import Prompt, ToolSpec
from smartplay_tools.types.arguments import well_formed
from smartplay_tools.types.messages import Message, MessageToolCall, calls_of, pictures_of, text_of
from smartplay_tools.types.pictures import Picture, is_picture

__all__ = [
    "SYSTEM",
    "accepted_name",
    "arguments_text",
    "check_names",
    "encodable",
    "function_call",
    "halves",
    "kept_item",
    "received",
    "reply_message",
    "sendable",
    "shown",
    "system_text",
    "taken_back",
    "with_pictures_below",
]

SYSTEM = ("system", "developer")
"""The roles of a message that gives instructions."""

P = TypeVar("P")

_REFUSED = re.compile(r"[^A-Za-z0-9_-]")
"""A character that the name of a tool must not have."""


def reply_message(
    text: str, calls: Iterable[MessageToolCall], item: dict[str, Any] | None = None, reasoning: str = ""
) -> Message:
    """Return a reply in canonical form.

    `item` is what the provider wants back unchanged, which `kept_item` returns; `reasoning` is its readable text.
    """
    message: Message = {"role": "assistant", "content": text or None}
    if listed := list(calls):
        message["tool_calls"] = listed
    if item is not None:
        message["provider_items"] = [item]
    if reasoning:
        message["reasoning_content"] = reasoning
    return message


def function_call(call_id: str, name: str, arguments: Any) -> MessageToolCall:
    """Return a call of a reply; arguments that a framework has parsed become JSON text again."""
    return {"id": call_id, "type": "function", "function": {"name": name, "arguments": arguments_text(arguments)}}


def arguments_text(arguments: Any) -> str:
    """Return the arguments of a call as JSON text, which is left as it is."""
    return arguments if isinstance(arguments, str) else json.dumps(arguments or {}, ensure_ascii=False)


def kept_item(message: Message, kind: str) -> dict[str, Any] | None:
    """Return the first provider item of a type; None if the message has none."""
    items = message.get("provider_items", ())
    return next((item for item in items if isinstance(item, dict) and item.get("type") == kind), None)


def system_text(messages: Iterable[Message]) -> str | None:
    """Return all instructions as one text, for providers that accept only one; None without any."""
    texts = [text_of(message) for message in messages if message["role"] in SYSTEM]
    return "\n\n".join(texts) if texts else None


def shown(
    message: Message, pictures: Mapping[str, Picture], text: Callable[[str], P], picture: Callable[[Picture], P]
) -> str | list[P]:
    """Return the text of a message; if it names pictures, the list of its parts, each made by `text` or `picture`."""
    if not pictures_of(message):
        return text_of(message)
    parts = cast(list[dict[str, Any]], message["content"])  # only a list has pictures
    return [picture(pictures[part["sha256"]]) if is_picture(part) else text(part["text"]) for part in parts]


def with_pictures_below(prompt: Prompt) -> Prompt:
    """Return a prompt whose pictures are in a user message after the results of each turn, and not in the results."""
    if not prompt.pictures:
        return prompt
    words = Wording.of(prompt.version or VERSION)
    shown, below, stable = list[Message](), list[dict[str, Any]](), 0
    for at, message in enumerate([*prompt.messages, _END]):
        if below and message["role"] != "tool":
            shown.append({"role": "user", "content": below})
            below = []
        if at == prompt.prefix_messages:
            stable = len(shown)
        if named := pictures_of(message):
            for part in named:
                below += [{"type": "text", "text": words("picture_of", id=message["tool_call_id"])}, dict(part)]
            message = message.copy()
            message["content"] = f"{text_of(message)}\n{words('picture_below')}"
        shown.append(message)
    return replace(prompt, shared=shown[:-1], prefix_messages=stable)


_END: Message = {"role": "user", "content": None}
"""Stands after the last message, so that the pictures of the last results have a place before it."""


def received(messages: list[Message], tools: tuple[ToolSpec, ...] = (), max_tokens: int | None = None) -> Prompt:
    """Return a prompt that came through a provider's interface; its last message tells if it asks for a summary."""
    last = messages[-1] if messages and messages[-1]["role"] == "user" else None
    is_request = (
        last is not None and _summary_request(in_any_version("summary_request")).fullmatch(text_of(last)) is not None
    )
    return Prompt(messages, tools, max_tokens, purpose="summary" if is_request else "play")


@functools.cache
def _summary_request(sentences: Sequence[str]) -> re.Pattern[str]:
    requests = (map(re.escape, text.split("{tokens}")) for text in sentences)
    return re.compile("|".join(r"\d+".join(parts) for parts in requests))


def encodable(value: Any) -> Any:
    """Copy a JSON value as requests can hold it, however deeply it is nested.

    A lone surrogate, which UTF-8 cannot hold, becomes U+FFFD, and a number that JSON cannot hold becomes its name.
    """
    if isinstance(value, str):
        return well_formed(value)
    copy = [value]
    waiting: list[Any] = [copy]
    while waiting:
        parent = waiting.pop()
        for place, item in enumerate(parent) if isinstance(parent, list) else parent.items():
            if isinstance(item, str):
                parent[place] = well_formed(item)
            elif isinstance(item, dict):
                parent[place] = {well_formed(key): own for key, own in item.items()}
                waiting.append(parent[place])
            elif isinstance(item, list | tuple):
                parent[place] = [*item]
                waiting.append(parent[place])
            elif isinstance(item, float) and not math.isfinite(item):
                parent[place] = str(item)
    return copy[0]


def sendable(message: Message) -> Message:
    """Return a copy of a message as requests can hold it: without half characters, its tools by accepted names."""
    copy: Message = encodable(message)
    if calls := calls_of(copy):
        copy["tool_calls"] = [_sendable_call(call) for call in calls]
    return copy


def taken_back(messages: Sequence[Message]) -> Sequence[Message]:
    """Return messages of a prompt without what no provider takes back: surplus calls, and the end of endless words."""
    if all(len(message.get("tool_calls", ())) <= most("calls") and not _is_endless(message) for message in messages):
        return messages
    surplus: set[str] = set()
    kept: list[Message] = []
    for message in messages:
        if calls := calls_of(message):
            surplus = {call["id"] for call in calls[most("calls") :]}
            message = {**message, "tool_calls": [*calls[: most("calls")]]}
        if _is_endless(message):
            message = {**message, "content": shortened(text_of(message), most("words"))}
        if message["role"] != "tool" or message.get("tool_call_id") not in surplus:
            kept.append(message)
    return kept


def _is_endless(message: Message) -> bool:
    content = message["content"]
    return isinstance(content, str) and len(content) > most("words")


def _sendable_call(call: MessageToolCall) -> MessageToolCall:
    name, arguments = accepted_name(call["function"]["name"]), call["function"]["arguments"]
    return {"id": call.get("id") or "", "type": "function", "function": {"name": name, "arguments": arguments}}


def accepted_name(name: str, longest: int = 64) -> str:
    """Return the name of a tool as providers accept it in requests; the record keeps the name that a model invented."""
    return _REFUSED.sub("_", name)[:longest] or "_"


def halves(text: str) -> Iterator[str]:
    """Yield a text in two nonempty pieces, as a stream delivers a reply."""
    middle = (len(text) + 1) // 2
    yield from filter(None, (text[:middle], text[middle:]))


def check_names(tools: Iterable[tuple[str, object]], own: Mapping[str, object] = MappingProxyType({})) -> None:
    """Raise an `InvalidArgumentError` for two tools with one name, which frameworks and models confuse.

    `tools` are names, each with the object that plays its calls, and `own` has those of the game. Of two tools a
    framework may have kept one: whatever it looks like, only the very object plays this episode.
    """
    named = [*tools]
    twice = {name for name, count in Counter(name for name, _ in named).items() if count > 1}
    others = {name for name, tool in named if own.get(name, tool) is not tool}
    if clash := sorted(twice | others):
        also = ", and leave out those of a toolkit or of another episode" if own.keys() & clash else ""
        raise InvalidArgumentError(f"Two tools have the name {', '.join(clash)}; rename yours{also}.")
