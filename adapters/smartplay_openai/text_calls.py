"""Tool calls that a model writes as text.

Models are trained on one format each, and a server that knows it turns the text into calls. For one that does not,
`parse_calls` names the format, and the player reads it. What cannot be read stays text: nothing is guessed.

    hermes    <tool_call>{"name": "act", "arguments": {...}}</tool_call>            Qwen, Hermes
    llama     {"name": "act", "parameters": {...}}, several with ;                  Llama 3
    mistral   [TOOL_CALLS][{"name": "act", "arguments": {...}}] or NAME[ARGS]{...}  Mistral, Magistral
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from smartplay_tools import InvalidArgumentError, Message
from smartplay_tools.players.conversion import function_call
from smartplay_tools.types.arguments import value_in

WordsAndCalls = tuple[str, list[tuple[str, str]]]
"""The words around the calls, and each call's name and arguments as JSON."""

_HERMES = re.compile(r"<tool_call>\s*(.*?)\s*(?:</tool_call>|\Z)", re.DOTALL)
_THINKING = re.compile(r"<think>.*?</think>", re.DOTALL)
_THINKING_OR_HERMES = re.compile(f"(?P<thinking>{_THINKING.pattern})|{_HERMES.pattern}", re.DOTALL)
_MISTRAL = re.compile(r"(?:\[TOOL_CALLS\])?\s*([A-Za-z0-9_-]+)(?:\[CALL_ID\]\S+?)?\[ARGS\]\s*")
_DECODER = json.JSONDecoder()


def _hermes(text: str) -> WordsAndCalls | None:
    calls = [_named(value_in(body)) for body in _HERMES.findall(_THINKING.sub("", text))]
    if not calls or not all(calls):
        return None
    words = _THINKING_OR_HERMES.sub(lambda match: match["thinking"] or "", text)
    return words, [call for call in calls if call]


def _llama(text: str) -> WordsAndCalls | None:
    before, _, after = text.rpartition("<|python_tag|>")
    calls = [_named(value) for value in _values(after, separator=";")]
    return (before, [call for call in calls if call]) if calls and all(calls) else None


def _mistral(text: str) -> WordsAndCalls | None:
    words, mark, rest = text.partition("[TOOL_CALLS]")
    if not mark:
        return None
    if rest.lstrip().startswith("["):
        listed = value_in(rest.strip())
        calls = [_named(value) for value in listed] if isinstance(listed, list) else []
        return (words, [call for call in calls if call]) if calls and all(calls) else None
    read, at = list[tuple[str, str]](), 0
    while match := _MISTRAL.match(rest, at):
        try:
            value, at = _DECODER.raw_decode(rest, match.end())
        except (ValueError, RecursionError):
            return None
        read.append((match[1], json.dumps(value, ensure_ascii=False)))
    return (words, read) if read and not rest[at:].strip() else None


PARSERS: Mapping[str, Callable[[str], WordsAndCalls | None]] = {"hermes": _hermes, "llama": _llama, "mistral": _mistral}


def check_parser(name: str | None) -> None:
    """Raise an `InvalidArgumentError` for a format that is not known."""
    if name is not None and name not in PARSERS:
        raise InvalidArgumentError(f"parse_calls is {', '.join(PARSERS)}, not {name!r}.")


def with_calls(message: Message, parser: str) -> Message:
    """Return a message with the calls that its text holds; the same message if it has calls, or none can be read."""
    text = message.get("content")
    if message.get("tool_calls") or not isinstance(text, str) or (read := PARSERS[parser](text)) is None:
        return message
    words, calls = read
    listed = [function_call(f"text_{at}", name, arguments) for at, (name, arguments) in enumerate(calls)]
    return {**message, "content": words.strip() or None, "tool_calls": listed}


def _named(value: Any) -> tuple[str, str] | None:
    """The name and the arguments of a call as formats write it."""
    if not isinstance(value, Mapping) or not isinstance(value.get("name"), str):
        return None
    arguments = value.get("arguments", value.get("parameters", {}))
    return value["name"], arguments if isinstance(arguments, str) else json.dumps(arguments, ensure_ascii=False)


def _values(text: str, separator: str) -> Iterator[Any]:
    """The JSON values of a text that holds nothing else; None for one that cannot be read."""
    at = 0
    text = text.strip()
    while at < len(text):
        try:
            value, at = _DECODER.raw_decode(text, at)
        except (ValueError, RecursionError):
            yield None
            return
        yield value
        at += len(text[at:]) - len(text[at:].lstrip(f"{separator} \n\t"))
