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
    """Return the arguments of a call; None where docs/records.md calls them malformed."""
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


def as_sent(reply: Mapping[str, Any]) -> dict[str, Any]:
    """Return a reply as later prompts hold it: the arguments of its calls are objects."""
    calls = [
        {**call, "function": {**call["function"], "arguments": _sent(call["function"]["arguments"])}}
        for call in reply.get("tool_calls", ())
    ]
    words = reply["content"] if calls or text_of(reply).strip() else "..."
    return {**reply, "content": words, **({"tool_calls": calls} if calls else {})}


def _sent(arguments: str) -> str:
    if arguments.strip() in ("", "null"):
        return "{}"
    try:
        printed = json.dumps(read_object(arguments), ensure_ascii=False, allow_nan=False)
        is_object = read_object(without_surrogates(printed)) is not None
    except ValueError:  # a number beyond every double
        is_object, printed = False, ""
    if not is_object:
        return json.dumps({"arguments": without_surrogates(arguments)}, ensure_ascii=False)
    return arguments if printed == without_surrogates(printed) else without_surrogates(printed)


UNREAD = (
    "id call_id call_ids tool_call_id type kind part_kind role phase format status index signature thought_signature"
)
UNREAD += (
    " thoughtSignature encrypted_content encrypted_index cache_control model response_id model_name model_provider"
)
UNREAD += " provider_name"


def thoughts(message: Mapping[str, Any]) -> str:
    """Return the text of a reply's thoughts: `reasoning_content`, then all that is readable in its items."""

    def readable(value: Any) -> list[str]:
        if isinstance(value, dict) and value.get("type") == "function_call":
            return []  # counted as a call
        if isinstance(value, dict):
            inner = [readable(each) for name, each in value.items() if name not in UNREAD.split()]
        else:
            inner = [readable(each) for each in value] if isinstance(value, list) else []
        return [value] if isinstance(value, str) else [text for texts in inner for text in texts]

    return message.get("reasoning_content", "") + "".join(readable(message.get("provider_items", [])))


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
        return tokens + n(thoughts(message))

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
