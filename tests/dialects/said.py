"""What a scripted model says, in nobody's format, and what a server has been told, in nobody's format either."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

Json = dict[str, Any]

CUT, REFUSED, FILTERED = "cut", "refused", "filtered"
"""Why a reply ended, if not because it was whole."""


@dataclass(frozen=True)
class Said:
    """A reply of the model."""

    words: str = ""
    thoughts: str = ""
    calls: tuple[tuple[str, str], ...] = ()
    """Name and arguments of each, these as the model wrote them."""
    end: str = ""
    same_ids: bool = False
    """Whether all calls have one id."""


@dataclass
class Turn:
    """A message of a request. What a format spreads over several messages or items is one turn."""

    role: str
    words: str = ""
    calls: list[tuple[str, str, Any]] = field(default_factory=list)
    """Id, name and arguments of each, these as they were sent."""
    results: list[str] = field(default_factory=list)
    """The ids of the calls of which it has the results."""
    raw: Any = None


def plainer(said: Said, without: Collection[str]) -> Said:
    """The reply without what a format or a framework cannot transport.

    Without "broken" arguments, what is no object is an empty one; without "values", what is JSON and no object is
    broken JSON; without "cuts", every reply is whole.
    """
    calls = [(name, text if is_object(text) else _plainer(text, without)) for name, text in said.calls]
    thoughts = "" if "thoughts" in without else said.thoughts
    end = "" if "cuts" in without and said.end in (CUT, FILTERED) else said.end
    same_ids = said.same_ids and "repeated" not in without
    return replace(said, thoughts=thoughts, calls=tuple(calls), end=end, same_ids=same_ids)


def _plainer(arguments: str, without: Collection[str]) -> str:
    if "broken" in without:
        return "{}"
    return (
        arguments[:-1]
        if arguments and "values" in without and parsed(arguments, constants=True) is not ValueError
        else arguments
    )


def is_object(arguments: Any) -> bool:
    return isinstance(parsed(arguments, constants=False), dict)


def parsed(arguments: Any, *, constants: bool) -> Any:
    """The value of arguments that are JSON; `ValueError` as the value if they are not. Some parsers take NaN."""

    def refuse(name: str) -> Any:
        raise ValueError(name)

    if not isinstance(arguments, str):
        return arguments
    try:
        return json.loads(arguments, parse_constant=None if constants else refuse)
    except ValueError:
        return ValueError


# --- Requests ----------------------------------------------------------------------------------------------------


def read_chat(body: Json) -> list[Turn]:
    turns = []
    for message in body["messages"]:
        calls = [
            (c.get("id"), c["function"]["name"], c["function"]["arguments"]) for c in message.get("tool_calls") or ()
        ]
        results = [message.get("tool_call_id")] if message["role"] == "tool" else []
        turns.append(Turn(message["role"], _text(message.get("content")), calls, results, message))
    return turns


def read_responses(body: Json) -> list[Turn]:
    items = [{"role": "user", "content": body["input"]}] if isinstance(body["input"], str) else body["input"]
    turns: list[Turn] = []
    for item in items:
        kind = item.get("type", "message")
        if kind == "function_call_output":
            turns.append(Turn("tool", _text(item["output"]), results=[item["call_id"]], raw=[item]))
        elif kind == "message" and item["role"] != "assistant":
            turns.append(Turn(item["role"], _text(item["content"]), raw=[item]))
        else:
            if not turns or turns[-1].role != "assistant":
                turns.append(Turn("assistant", raw=[]))
            turns[-1].raw.append(item)
            if kind == "message":
                turns[-1].words += _text(item["content"])
            elif kind == "function_call":
                turns[-1].calls.append((item["call_id"], item["name"], item["arguments"]))
    return turns


def read_messages(body: Json) -> list[Turn]:
    turns = []
    for message in body["messages"]:
        content = message["content"]
        blocks = [{"type": "text", "text": content}] if isinstance(content, str) else content
        calls = [(b["id"], b["name"], b["input"]) for b in blocks if b["type"] == "tool_use"]
        results = [b["tool_use_id"] for b in blocks if b["type"] == "tool_result"]
        turns.append(Turn(message["role"], _text(blocks), calls, results, blocks))
    return turns


def _text(content: Any) -> str:
    if isinstance(content, list):
        return "".join(part.get("text") or "" for part in content if isinstance(part, Mapping))
    return content or ""


# --- What somebody can read ----------------------------------------------------------------------------------------

NOT_READ = frozenset(
    [
        "annotations",
        "cache_control",
        "call_id",
        "data",
        "encrypted_content",
        "format",
        "id",
        "index",
        "logprobs",
        "name",
        "object",
        "prompt_cache_breakpoint",
        "role",
        "signature",
        "status",
        "thought_signature",
        "tool_call_id",
        "tool_use_id",
        "type",
    ]
)
"""Fields of messages that nobody reads: ids, types and formats, signatures, encrypted data. Names are short."""


def readable(value: Any) -> Iterator[str]:
    """Every text in the messages of a request that a person could read, under whatever name it stands."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, list):
        for item in value:
            yield from readable(item)
    elif isinstance(value, dict):
        for key, item in value.items():
            if key in ("arguments", "input") and isinstance(item, dict):
                yield json.dumps(item, ensure_ascii=False)
            elif key not in NOT_READ:
                yield from readable(item)
