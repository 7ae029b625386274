"""The answers of compatible servers as plain data, and tool calls that a model writes as text.

Models are trained on one format each, and a server that knows it turns the text into calls. For one that does not,
`parse_calls` names the format, and the player reads it. What cannot be read stays text: nothing is guessed.

    hermes    <tool_call>{"name": "act", "arguments": {...}}</tool_call>            Qwen, Hermes
    llama     {"name": "act", "parameters": {...}}, several with ;                  Llama 3
    mistral   [TOOL_CALLS][{"name": "act", "arguments": {...}}] or NAME[ARGS]{...}  Mistral, Magistral

The client does not validate what a server sends, and compatible servers deviate from the interface in many ways.
Everything here is therefore read from plain dictionaries, without assumptions about their contents.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from smartplay_tools import InvalidArgumentError, Message, SampledTokens, Usage
from smartplay_tools.players import count_in, reported_in
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


READ = ("cached_tokens", "prompt_cache_hit_tokens", "cache_read_input_tokens", "num_cached_tokens")
"""The names of the tokens read from a cache: OpenAI's and Kimi's, DeepSeek's, LiteLLM's, Mistral's."""

WRITTEN = ("cache_write_tokens", "cache_creation_tokens", "cache_creation_input_tokens")
"""The names of the tokens written to a cache: OpenAI's, and LiteLLM's two."""


def read_usage(usage: Any, prompt: str, reply: str) -> Usage | None:
    """Return the provider's usage; `prompt` and `reply` are the interface's names, such as `input` and `output`."""
    if not isinstance(usage, Mapping):
        return None
    parts, drawn = usage.get(f"{prompt}_tokens_details"), usage.get(f"{reply}_tokens_details")
    cached = [count for count in (reported_in(parts, *READ), reported_in(usage, *READ)) if count is not None]
    read = Usage(
        prompt=count_in(usage, f"{prompt}_tokens"),
        reply=count_in(usage, f"{reply}_tokens"),
        cached=max(cached, default=None),
        written=max(reported_in(parts, *WRITTEN) or 0, reported_in(usage, *WRITTEN) or 0),
        reasoning=max(count_in(drawn, "reasoning_tokens"), count_in(usage, "reasoning_tokens")),
    )
    return read.checked(reported_in(usage, "total_tokens"))


def sampled_tokens(choice: Mapping[str, Any], prompt: Any) -> SampledTokens | None:
    """Return the tokens of a reply, which vLLM and LMDeploy send where `return_token_ids` asks for them.

    Their probabilities are there if `logprobs` asks for these, too; `prompt` are the prompt's tokens.
    """
    ids, logprobs = choice.get("token_ids"), choice.get("logprobs")
    if not isinstance(ids, list):
        return None
    content = logprobs.get("content") if isinstance(logprobs, Mapping) else None
    try:
        drawn = [each["logprob"] for each in content or ()]
        logprobs = tuple(drawn) if len(drawn) == len(ids) else None
        return SampledTokens(reply=tuple(ids), logprobs=logprobs, prompt=prompt)
    except (KeyError, TypeError, ValueError):
        return None
