"""What requests cost under the rule of a cache: the definition of hits, writes and cost, as a function of a record.

A figure of this kind is a model of a bill. It leaves out what a record cannot know: entries of other episodes, repeated
attempts at a reply, and evictions before an entry's life is over. The first makes a bill smaller, the others larger.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import fsum
from typing import Any, Literal, NamedTuple, get_args

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.records.caches import CacheRule
from smartplay_tools.records.prices import Price
from smartplay_tools.records.requests import Request, RequestLog

Place = Literal["stable", "end"]
"""Where a player marks a prompt: at the end of what is unchanged since the prompt before, or at its own end."""

PLACES: tuple[Place, ...] = get_args(Place)


def marks_of(player_options: Mapping[str, Any]) -> Sequence[Place]:
    """Return where a player with these options marks its prompts."""
    match player_options.get("cache", True):
        case "stable":
            return ("stable",)
        case False:
            return ()
    return PLACES


class ChargedCall(NamedTuple):
    """The tokens of a request as they are charged. `hit` and `written` are parts of `prompt` without overlap."""

    prompt: int
    hit: int
    written: int
    reply: int


@dataclass(frozen=True)
class Charge:
    """What calls come to."""

    calls: int
    prompt: int
    hit: int
    written: int
    reply: int
    cost: float
    """In US dollars, or in uncached tokens of the input where there is no price."""
    area: float
    """The area under the score over the cost: of every call, its cost times the score when it was made."""


def charge(log: RequestLog, rule: CacheRule, *, marks: Sequence[Place] = PLACES, price: Price | None = None) -> Charge:
    """Return what an episode's requests cost under a rule; see `calls_under`."""
    calls = calls_under(log, rule, marks=marks)
    prompt, hit, written, reply = map(sum, zip(*calls, strict=True)) if calls else (0, 0, 0, 0)
    costs = rule.priced(price).each(calls)
    area = fsum(cost * request.score for cost, request in zip(costs, log.requests, strict=True))
    return Charge(len(calls), prompt, hit, written, reply, fsum(costs), area)


def calls_under(log: RequestLog, rule: CacheRule, *, marks: Sequence[Place] = PLACES) -> list[ChargedCall]:
    """Return the tokens of each request as a provider with this rule charges them.

    `marks` says where the player marks its prompts, for rules that cache only up to marks.
    """
    if unknown := set(marks) - set(PLACES):
        raise InvalidArgumentError(f"A mark is at one of {', '.join(PLACES)}, not {', '.join(sorted(unknown))}.")
    knows_times = all(request.at is not None for request in log.requests)
    cache = _Cache(rule, rule.life if knows_times else None)
    return [
        cache.call(request, path, answer, _marked(request, rule, marks))
        for request, path, answer in zip(log.requests, *log.paths(by_purpose=rule.tool_choice), strict=True)
    ]


class _Cache:
    """What a provider has stored: prefixes by their number, each with the time of its last use."""

    def __init__(self, rule: CacheRule, life: float | None) -> None:
        self._rule, self._life = rule, life
        self._used: dict[int, float] = {}

    def call(self, request: Request, path: Sequence[int], answer: int, marks: Sequence[int] | None) -> ChargedCall:
        """Return the tokens of a request, and store it.

        `path` has the number of each of its prefixes, `answer` is that of the request with its reply. `marks` are
        numbers of units; None where every request is stored whole.
        """
        rule, ends, now = self._rule, request.ends, request.at or 0.0
        length = self._longest(request, path, marks, now) if self._used else 0
        hit = self._down(min(ends[length], request.prompt - 1))
        if marks is None:
            self._used.update(dict.fromkeys(path, now))
            last = request.prompt
        else:
            stored = [length, *(mark for mark in marks if ends[mark] >= rule.minimum)]
            self._used.update((path[end - 1], now) for end in stored if end)
            last = ends[marks[-1]] if marks else 0
        if rule.replies and (marks is None or request.answered >= rule.minimum):
            self._used[answer] = now
        written = 0 if rule.write is None else max(0, self._down(last) - hit)
        return ChargedCall(request.prompt, hit, written, request.reply)

    def _longest(self, request: Request, path: Sequence[int], marks: Sequence[int] | None, now: float) -> int:
        """The longest stored prefix of a request that is looked for, in units."""
        if marks is None:
            length = len(path)
            while length and not self._has(path[length - 1], now):
                length -= 1
            return length
        lookback, longest = self._rule.lookback, 0
        for mark in reversed(marks):
            for length in range(mark, longest, -1):
                if lookback is not None and request.blocks[mark] - request.blocks[length] > lookback:
                    break
                if self._has(path[length - 1], now):
                    longest = length
                    break
        return longest

    def _has(self, prefix: int, now: float) -> bool:
        return prefix in self._used and (self._life is None or now - self._used[prefix] <= self._life)

    def _down(self, tokens: int) -> int:
        """Round down to whole blocks; less than the minimum is nothing."""
        whole = tokens - tokens % self._rule.block
        return whole if whole >= self._rule.minimum else 0


def _marked(request: Request, rule: CacheRule, places: Sequence[Place]) -> Sequence[int] | None:
    """The numbers of units after which a request is marked; None if it needs no marks."""
    if rule.marks == "auto":
        return None
    stable, end = request.stable, len(request.units)
    marks = [stable] if "stable" in places and 0 < stable < end else []
    marks += [end] if "end" in places or ("stable" in places and stable == end) else []
    return marks[max(0, len(marks) - rule.marks) :]
