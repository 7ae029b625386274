"""Thoughts as parts of a message's content, as Mistral's reasoning models have them.

    [{"type": "thinking", "thinking": [{"type": "text", "text": "A small disk ..."}]}, {"type": "text", "text": "Go."}]

The content of a canonical reply is its words. Its thoughts are provider items, which go back before the words as long
as their turn is in the window, because these models are made to see their earlier thoughts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from smartplay_openai.stream_pieces import merged
from smartplay_tools import Message

ITEM = "chat_thinking"
"""The type of the provider item that is one part with thoughts, with these as its `content`."""


def taken_apart(content: Any) -> tuple[Any, Sequence[Mapping[str, Any]]]:
    """Return the content of an answer without its thoughts, and the provider items of these."""
    if not isinstance(content, list):
        return content, ()
    thoughts = [part for part in content if _is_thinking(part)]
    if not thoughts:
        return content, ()
    return [part for part in content if not _is_thinking(part)] or None, [_item(part) for part in thoughts]


def put_together(message: Message) -> Any:
    """Return the content of a request's message, which has the thoughts of the reply if there are any."""
    content = message["content"]
    thoughts = [_part(item) for item in message.get("provider_items", ()) if _is_item(item)]
    if not thoughts:
        return content
    words = [{"type": "text", "text": content}] if isinstance(content, str) else content or ()
    return [*thoughts, *words]


def added(before: Any, value: Any) -> Any:
    """Return a content to which a piece of a stream is added; text and parts with thoughts may follow each other."""
    if isinstance(before, list) or isinstance(value, list):
        return merged([], [*map(_with_list, _listed(before)), *map(_with_list, _listed(value))])
    return before + value if isinstance(before, str) and isinstance(value, str) else value


def _listed(content: Any) -> Sequence[Any]:
    if isinstance(content, str):
        return [{"type": "text", "text": content}] if content else []
    if isinstance(content, list):
        return content
    return [] if content is None else [content]


def _with_list(part: Any) -> Any:
    """A part whose thoughts, which may be a text, are a list of parts."""
    return {**part, "thinking": _pieces(part)} if _is_thinking(part) else part


def _item(part: Mapping[str, Any]) -> dict[str, Any]:
    return {**{key: value for key, value in part.items() if key != "thinking"}, "type": ITEM, "content": _pieces(part)}


def _part(item: Mapping[str, Any]) -> dict[str, Any]:
    kept = {key: value for key, value in item.items() if key != "content"}
    return {**kept, "type": "thinking", "thinking": item["content"]}


def _pieces(part: Mapping[str, Any]) -> Sequence[Any]:
    return _listed(part.get("thinking"))


def _is_item(item: Any) -> bool:
    return isinstance(item, Mapping) and item.get("type") == ITEM


def _is_thinking(part: Any) -> bool:
    return isinstance(part, Mapping) and part.get("type") == "thinking"
