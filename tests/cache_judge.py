"""An independent judge of what prompts cost where they are cached: each request is compared with all before.

It is given plain data and imports nothing of the package: requests are sequences of labelled tokens, the tokens of
tools and messages that are equal have equal labels. The definition that it is written from is `docs/context-cost.md`.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import compress, count
from operator import ne
from typing import Any

from tests.counting import Count, message_tokens, plain_text, tools_tokens
from tests.model_from_docs.counting import thoughts

Json = dict[str, Any]
Tokens = list[tuple[str, int]]


@dataclass
class Asked:
    """A request: its tokens without priming, and what is known of each message in it."""

    tokens: Tokens
    ends: list[int]
    blocks: list[int]
    head: int
    stable: int
    whole: int
    purpose: str
    at: float | None
    with_reply: Tokens


class Units:
    """The tokens of tools and messages, computed once for all that are equal."""

    def __init__(self, n: Count) -> None:
        self._n = n
        self._made: dict[str, Tokens] = {}

    def tools(self, tools: Sequence[Json]) -> Tokens:
        return self._unit(tools, lambda: tools_tokens(tools, self._n))

    def message(self, message: Json) -> Tokens:
        return self._unit(message, lambda: message_tokens(message, self._n))

    def _unit(self, value: Any, length: Callable[[], int]) -> Tokens:
        label = json.dumps(value, sort_keys=True)
        if label not in self._made:
            self._made[label] = [(label, number) for number in range(length())]
        return self._made[label]


def asked(sent: Sequence[Json], replies: Sequence[Json], times: Sequence[float | None], n: Count) -> list[Asked]:
    """The requests of prompts, each with tools, messages and purpose, and their replies."""
    requests: list[Asked] = []
    units = Units(n)
    for number, (prompt, reply, at) in enumerate(zip(sent, replies, times, strict=True)):
        messages, before = prompt["messages"], sent[number - 1]["messages"] if number else []
        tokens = units.tools(prompt["tools"])
        ends, blocks = [len(tokens)], [0]
        for message in messages:
            tokens = tokens + units.message(message)
            ends.append(len(tokens))
            blocks.append(blocks[-1] + message_blocks(message))
        leading = 0
        while leading < len(messages) and messages[leading]["role"] in ("system", "developer"):
            leading += 1
        stable = 0
        while stable < min(len(messages), len(before)) and messages[stable] == before[stable]:
            stable += 1
        with_reply = tokens + units.message(reply)
        requests.append(
            Asked(tokens, ends, blocks, ends[leading], stable, len(tokens) + 3, prompt["purpose"], at, with_reply)
        )
    return requests


def message_blocks(message: Json) -> int:
    blocks = len(message.get("tool_calls") or [])
    blocks += 1 if plain_text(message["content"]) else 0
    blocks += 1 if thoughts(message) else 0
    return blocks or 1


def common(first: Tokens, second: Tokens) -> int:
    differing = compress(count(), map(ne, first, second))
    return next(differing, min(len(first), len(second)))


TooOld = Callable[[Any, Any], bool]
"""Whether what was last used at one time is forgotten at another."""


def judge(requests: Sequence[Asked], rule: Json, marks: Sequence[str], ratio: Fraction) -> list[tuple[int, int, int]]:
    """Prompt, hit and written tokens of each request."""

    def scaled(tokens: int) -> int:
        return int(tokens * ratio)

    def down(tokens: int) -> int:
        tokens -= tokens % rule["block"]
        return 0 if tokens < rule["minimum"] else tokens

    knows_times = all(request.at is not None for request in requests)

    def too_old(now: Any, then: Any) -> bool:
        return knows_times and rule["life"] is not None and now - then > rule["life"]

    charged = []
    entries: list[Json] = []
    for number, request in enumerate(requests):
        ends = marked_ends(request, rule, marks)
        if rule["marks"] == "auto":
            longest, last = common_with_earlier(requests[:number], request, rule, too_old), request.whole
        else:
            longest, read = longest_entry(entries, request, ends, rule, too_old)
            last = request.ends[ends[-1]] if ends else 0
            if read is not None:
                read["used"] = request.at
        whole = scaled(request.whole)
        hit = down(min(scaled(longest), whole - 1))
        charged.append((whole, hit, 0 if rule["write"] is None else max(0, down(scaled(last)) - hit)))
        kept = [request.tokens[: request.ends[end]] for end in ends]
        if rule["marks"] != "auto" and rule["replies"]:
            kept.append(request.with_reply)
        for tokens in kept:
            if scaled(len(tokens)) >= rule["minimum"]:
                store(entries, request, tokens)
    return charged


def marked_ends(request: Asked, rule: Json, marks: Sequence[str]) -> list[int]:
    """Which of a request's ends are marked."""
    if rule["marks"] in ("auto", 0):
        return []
    wanted = {"stable": request.stable, "end": len(request.ends) - 1}
    return sorted({wanted[place] for place in marks} - {0})[-rule["marks"] :]


def common_with_earlier(earlier: Sequence[Asked], request: Asked, rule: Json, too_old: TooOld) -> int:
    """The most tokens that a request has in common with the beginning of an earlier one."""
    longest = 0
    for other in earlier:
        if too_old(request.at, other.at):
            continue
        held = other.with_reply if rule["replies"] else other.tokens
        if rule["tool_choice"] and other.purpose != request.purpose:
            held = held[: other.head]
        longest = max(longest, common(request.tokens, held))
    return longest


def longest_entry(
    entries: Sequence[Json], request: Asked, ends: Sequence[int], rule: Json, too_old: TooOld
) -> tuple[int, Json | None]:
    """The longest entry that a request with marks at these ends reads, and its length."""
    longest, read = 0, None
    for entry in entries:
        size = len(entry["tokens"])
        if too_old(request.at, entry["used"]) or entry["tokens"] != request.tokens[:size]:
            continue
        if rule["tool_choice"] and size > entry["head"] and entry["purpose"] != request.purpose:
            continue
        at = request.ends.index(size)
        near = (request.blocks[end] - request.blocks[at] for end in ends if end >= at)
        if any(rule["lookback"] is None or blocks <= rule["lookback"] for blocks in near) and size > longest:
            longest, read = size, entry
    return longest, read


def store(entries: list[Json], request: Asked, tokens: Tokens) -> None:
    """Store the beginning of a request, or use what is stored of it."""
    same = [
        entry
        for entry in entries
        if entry["tokens"] == tokens and (len(tokens) <= request.head or entry["purpose"] == request.purpose)
    ]
    for entry in same:
        entry["used"] = request.at
    if not same:
        entries.append({"tokens": tokens, "purpose": request.purpose, "head": request.head, "used": request.at})
