"""Budget tokens of plain chat messages and tool schemas, written from `docs/budgets.md` alone."""

from __future__ import annotations

import functools
import json
from collections.abc import Callable, Sequence
from typing import Any

from tests.model_from_docs.counting import thoughts

Json = dict[str, Any]
Count = Callable[[str], int]


@functools.lru_cache(20_000)
def arguments_text(arguments: str) -> str:
    """A JSON object as `json.dumps(obj, ensure_ascii=False)`; anything else, repeated keys and NaN too, as sent."""

    def unique(pairs: list[tuple[str, Any]]) -> Json:
        if len({key for key, _ in pairs}) < len(pairs):
            raise ValueError
        return dict(pairs)

    def no_constant(name: str) -> None:
        raise ValueError(name)

    if len(arguments) > 10_000:
        return arguments
    try:
        value = json.loads(arguments, object_pairs_hook=unique, parse_constant=no_constant)
        return json.dumps(value, ensure_ascii=False, allow_nan=False) if isinstance(value, dict) else arguments
    except (ValueError, RecursionError):
        return arguments


def plain_text(content: Any) -> str:
    return content if isinstance(content, str) else "".join(part.get("text", "") for part in content or ())


def picture_tokens(content: Any) -> int:
    """Pictures by the rule `claude-28`: a token for each patch of 28 x 28 pixels, begun ones included."""
    parts = [] if isinstance(content, str) else [part for part in content or () if part["type"] == "image"]
    return sum(-(-part["width"] // 28) * -(-part["height"] // 28) for part in parts)


def message_tokens(message: Json, n: Count) -> int:
    total = 3 + n(message["role"]) + n(plain_text(message["content"])) + n(thoughts(message))
    total += picture_tokens(message["content"])
    if message.get("name"):
        total += 1 + n(message["name"])
    for call in message.get("tool_calls", ()):
        total += 3 + 8 + n(call["function"]["name"]) + n(arguments_text(call["function"]["arguments"]))
    return total + (8 if message["role"] == "tool" else 0)


def tools_tokens(tools: Sequence[Json], n: Count) -> int:
    total = 12 if tools else 0
    for tool in tools:
        total += 7 + n(f"{tool['name']}:{tool['description'].removesuffix('.')}")
        properties = tool["parameters"]["properties"]
        total += 3 if properties else 0
        for key, field in properties.items():
            if "enum" in field:
                total += -3 + sum(3 + n(item) for item in field["enum"])
            total += 3 + n(f"{key}:{field.get('type', '')}:{field['description'].removesuffix('.')}")
    return total
