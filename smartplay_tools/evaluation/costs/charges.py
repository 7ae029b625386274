"""What requests cost under the rule of a cache: the definition of hits, writes and cost, as a function of a record.

A figure of this kind is a model of a bill. It leaves out what a record cannot know: entries of other episodes, repeated
attempts at a reply, and evictions before an entry's life is over. The first makes a bill smaller, the others larger.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from math import fsum, inf
from operator import mul
from typing import NamedTuple

from smartplay_tools.costs.cached import PLACES, MarkedPrefixes, Place, Prefixes, marked, whole_blocks
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.providers.caches import CacheRule
from smartplay_tools.providers.prices import Price
from smartplay_tools.records.requests import Request, RequestLog

__all__ = ["Charge", "calls_under", "charge"]


class ChargedCall(NamedTuple):
    """The tokens of a request as they are charged. `hit` and `written` are parts of `prompt` without overlap."""

    prompt: int
    hit: int
    written: int
    reply: int


@dataclass(frozen=True)
class Charge:
    """The total of an episode's calls."""

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
    prompts, replies, scores = log.columns
    hits, written = _cached(log, rule, marks)
    costs = rule.priced(price).each(zip(prompts, hits, written, replies, strict=True))
    area = fsum(map(mul, costs, scores))
    return Charge(len(prompts), sum(prompts), sum(hits), sum(written), sum(replies), fsum(costs), area)


def calls_under(log: RequestLog, rule: CacheRule, *, marks: Sequence[Place] = PLACES) -> list[ChargedCall]:
    """Return the tokens of each request as a provider with this rule charges them.

    `marks` says where the player marks its prompts, for rules that cache only up to marks.
    """
    prompts, replies, _ = log.columns
    return [*map(ChargedCall, prompts, *_cached(log, rule, marks), replies)]


def _cached(log: RequestLog, rule: CacheRule, places: Sequence[Place]) -> tuple[Sequence[int], Sequence[int]]:
    """The hits and the written tokens of each request."""
    if unknown := set(places) - set(PLACES):
        raise InvalidArgumentError(f"A mark is at one of {', '.join(PLACES)}, not {', '.join(sorted(unknown))}.")
    matched, stored = _matched_and_stored(log, rule, tuple(places))
    hits = [whole_blocks(length, rule) for length in matched]
    if rule.write is None:
        return hits, [0] * len(hits)
    return hits, [max(0, whole_blocks(end, rule) - hit) for end, hit in zip(stored, hits, strict=True)]


def _matched_and_stored(
    log: RequestLog, rule: CacheRule, places: tuple[Place, ...]
) -> tuple[Sequence[int], Sequence[int]]:
    """The tokens of each request that are found stored, and those that are stored after it.

    They are the same under all rules that differ in minimum, blocks and rates alone: a prefix below the minimum is no
    hit, whether it is stored or not, and a longer one is preferred to it.
    """
    prefixes = log.prefixes_by_purpose if rule.tool_choice else log.prefixes
    life = inf if rule.life is None or log.seconds is None or log.seconds <= rule.life else rule.life
    key = prefixes is log.prefixes, rule.marks, rule.lookback, rule.replies, life, places
    if key not in log.remembered:
        prompts, tokens = log.columns[0], prefixes.tokens
        if rule.marks == "auto":
            lengths, stored = _stored_whole(log.requests, prefixes, rule, life), prompts
        else:
            marks = [marked(request.units, request.stable, rule.marks, places) for request in log.requests]
            entries, lengths = MarkedPrefixes(prefixes, rule, life), []
            for at, (request, ends) in enumerate(zip(log.requests, marks, strict=True)):
                lengths.append(entries.find(at, ends, request.at or 0.0))
                entries.store_reply(at, request.at or 0.0)
            stored = [tokens[path[ends[-1]]] if ends else 0 for path, ends in zip(prefixes.paths, marks, strict=True)]
        matched = zip(prefixes.paths, lengths, prompts, strict=True)
        # The last token of a prompt is always computed.
        log.remembered[key] = [min(tokens[path[length]], prompt - 1) for path, length, prompt in matched], stored
    of_each: tuple[Sequence[int], Sequence[int]] = log.remembered[key]
    return of_each


def _stored_whole(requests: Sequence[Request], prefixes: Prefixes, rule: CacheRule, life: float) -> Sequence[int]:
    """The length in units of the longest stored prefix of each request, where requests are stored whole.

    Where a prefix is stored, all that it begins with are, and were used no earlier, so that the longest is found by
    bisection.
    """
    if life == inf:
        return prefixes.shared_with_reply if rule.replies else prefixes.shared
    used: dict[int, float] = {}
    lengths = []
    for request, path, answer in zip(requests, prefixes.paths, prefixes.answers, strict=True):
        now = request.at or 0.0
        lengths.append(bisect_left(path, True, lo=1, key=lambda prefix: now - used.get(prefix, -inf) > life) - 1)
        used.update(dict.fromkeys(path, now))
        if rule.replies:
            used[answer] = now
    return lengths
