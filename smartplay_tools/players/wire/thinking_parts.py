"""Parts of a message's content that are not its words, such as the thoughts of Mistral's reasoning models.

    [{"type": "thinking", "thinking": [{"type": "text", "text": "A small disk ..."}]}, {"type": "text", "text": "Go."}]

The content of a canonical reply is its words. Its other parts, of whatever kind, are provider items, which go back to
their place among the words as long as their turn is in the window: models are made to see their earlier thoughts, and
servers refuse signed ones that are missing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from smartplay_tools.players.wire.stream_pieces import merged
from smartplay_tools.providers.reply_fields import OTHER_PART, THOUGHTS
from smartplay_tools.types.messages import Message

ITEM = "chat_thinking"
"""The type of the provider item that is one part with thoughts, with these as its `content`."""

PLACE = "content_place"
"""The field of a provider item with the place of its part in the content, unless nothing but such parts precede it."""


def taken_apart(content: Any) -> tuple[Any, Sequence[Mapping[str, Any]]]:
    """Return the words in the content of an answer, and the provider items of its other parts."""
    parts = _listed(content)
    others = [(at, part) for at, part in enumerate(parts) if _is_other(part)]
    if not others and not isinstance(content, Mapping):
        return content, ()
    items = [_item(part) if at == number else {**_item(part), PLACE: at} for number, (at, part) in enumerate(others)]
    return [part for part in parts if not _is_other(part)] or None, items


def put_together(message: Message) -> Any:
    """Return the content of a request's message, which has all parts of the reply if it was more than words."""
    content = message["content"]
    items = [item for item in message.get("provider_items", ()) if _is_item(item)]
    if not items:
        return content
    parts = [*_listed(content)]
    for number, item in enumerate(items):
        parts.insert(item.get(PLACE, number), part_of(item))
    return parts


def added(before: Any, value: Any) -> Any:
    """Return a content to which a piece of a stream is added; text and parts with thoughts may follow each other."""
    if isinstance(before, list | Mapping) or isinstance(value, list | Mapping):
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
    if not _is_thinking(part):
        return {**part, "type": OTHER_PART, "part_kind": part.get("type")}
    return {**{key: value for key, value in part.items() if key != "thinking"}, "type": ITEM, "content": _pieces(part)}


def part_of(item: Mapping[str, Any]) -> dict[str, Any]:
    """Return the part of a content that a provider item holds."""
    kept = {key: value for key, value in item.items() if key not in ("type", PLACE, "part_kind")}
    if item["type"] == OTHER_PART:
        return kept if item["part_kind"] is None else {"type": item["part_kind"], **kept}
    return {"type": "thinking", "thinking": kept.pop("content"), **kept}


def _pieces(part: Mapping[str, Any]) -> Sequence[Any]:
    return _listed(part.get("thinking"))


def _is_item(item: Any) -> bool:
    return isinstance(item, Mapping) and item.get("type") in (ITEM, OTHER_PART)


def _is_thinking(part: Any) -> bool:
    return isinstance(part, Mapping) and part.get("type") == "thinking"


def _is_other(part: Any) -> bool:
    """Whether a part is not words: its kind is one of thoughts, or it has no text."""
    if not isinstance(part, Mapping):
        return False
    return part.get("type") in THOUGHTS or not any(isinstance(part.get(field), str) for field in ("text", "refusal"))
