"""Budget tokens as docs/budgets.md defines them, from a tokenizer's count of a text alone."""

from __future__ import annotations

import functools
import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import smartplay_tools as sp

DEEPEST = 100
LONGEST = 10_000
PRIMING = 3


class _MalformedError(ValueError):
    pass


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    if len({key for key, _ in pairs}) < len(pairs):
        raise _MalformedError
    return dict(pairs)


def _refuse(constant: str) -> Any:
    raise _MalformedError(constant)


def _depth(value: Any) -> int:
    inner = value.values() if isinstance(value, dict) else value if isinstance(value, list) else None
    return 0 if inner is None else 1 + max(map(_depth, inner), default=0)


def read_object(text: str) -> dict[str, Any] | None:
    """Return the arguments of a call; None where docs/architecture.md calls them malformed."""
    if not text:
        return {}
    if len(text) > LONGEST:
        return None
    try:
        value = json.loads(text, object_pairs_hook=_object, parse_constant=_refuse)
    except (ValueError, RecursionError):
        return None
    return value if isinstance(value, dict) and _depth(value) <= DEEPEST else None


def text_of(message: Mapping[str, Any]) -> str:
    """Return a message's text; of a list of parts, those that are text, joined."""
    content = message["content"]
    if isinstance(content, list):
        return "".join(part["text"] for part in content if part["type"] == "text")
    return content or ""


def without_surrogates(text: str) -> str:
    """Return the text as it is counted: pairs are characters, and lone halves U+FFFD."""
    joined = text.encode("utf-16-le", "surrogatepass").decode("utf-16-le", "surrogatepass")
    return re.sub("[\ud800-\udfff]", "\ufffd", joined)


def _visible(items: Any) -> str:
    """The visible text of a provider's items: `text` and `thinking`, also inside of `summary` and `content`."""
    if isinstance(items, list):
        return "".join(map(_visible, items))
    if not isinstance(items, dict):
        return ""
    shown = {"text": str, "thinking": str}
    return "".join(
        value if key in shown and isinstance(value, str) else _visible(value) if key in ("summary", "content") else ""
        for key, value in items.items()
    )


class Counting:
    """What texts, messages, tools and prompts cost."""

    def __init__(self, text: Callable[[str], int], picture: Callable[[int, int], int]) -> None:
        """`text` counts a text without surrogates, `picture` a picture by its width and height."""
        self.picture = picture
        self.text = functools.lru_cache(100_000)(lambda words: text(without_surrogates(words)))

    def message(self, message: Mapping[str, Any]) -> int:
        """Return the tokens of a message."""
        n = self.text
        tokens = 3 + n(message["role"]) + n(text_of(message))
        if isinstance(message["content"], list):
            parts = (part for part in message["content"] if part["type"] == "image")
            tokens += sum(self.picture(part["width"], part["height"]) for part in parts)
        if message.get("name"):
            tokens += 1 + n(message["name"])
        for call in message.get("tool_calls", ()):
            tokens += 3 + 8 + n(call["function"]["name"]) + n(self.as_counted(call["function"]["arguments"]))
        if message["role"] == "tool":
            tokens += 8
        return tokens + n(message.get("reasoning_content", "") + _visible(message.get("provider_items", [])))

    @staticmethod
    def as_counted(arguments: str) -> str:
        """Return arguments as `json.dumps` prints them if they are well-formed, otherwise as sent."""
        value = read_object(arguments)
        if value is None or not arguments:
            return arguments
        try:
            return json.dumps(value, ensure_ascii=False, allow_nan=False)
        except ValueError:  # 1e999, which Python reads as infinity
            return arguments

    def messages(self, messages: Iterable[Mapping[str, Any]]) -> int:
        """Return the tokens of messages."""
        return sum(map(self.message, messages))

    def tools(self, tools: Sequence[sp.ToolSpec]) -> int:
        """Return the tokens of tool schemas."""
        n, tokens = self.text, 12
        for tool in tools:
            properties = tool.parameters.get("properties") or {}
            tokens += 7 + n(f"{tool.name}:{tool.description.removesuffix('.')}") + (3 if properties else 0)
            for key, field in properties.items():
                tokens += 3 + n(f"{key}:{field.get('type', '')}:{field.get('description', '').removesuffix('.')}")
                if "enum" in field:
                    tokens += -3 + sum(3 + n(str(value)) for value in field["enum"])
        return tokens
