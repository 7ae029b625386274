"""What requests cost under the rule of a cache: the definition of hits, writes and cost, as a function of a record.

A figure of this kind is a model of a bill. It leaves out what a record cannot know: entries of other episodes, repeated
attempts at a reply, and evictions before an entry's life is over. The first makes a bill smaller, the others larger.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import fsum, inf
from operator import mul
from typing import NamedTuple

from smartplay_tools.costs.cached import PLACES, Cache, Place, hit_and_written
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.providers.caches import CacheRule
from smartplay_tools.providers.prices import Price
from smartplay_tools.records.requests import RequestLog

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
    pairs = [hit_and_written(*found, rule) for found in _found_and_stored(log, rule, tuple(places))]
    return [hit for hit, _ in pairs], [written for _, written in pairs]


def _found_and_stored(log: RequestLog, rule: CacheRule, places: tuple[Place, ...]) -> Sequence[tuple[int, int]]:
    """The tokens of each request that are found stored, and those that are stored after it.

    They are the same under all rules that differ in minimum, blocks and rates alone: a prefix below the minimum is no
    hit, whether it is stored or not, and a longer one is preferred to it.
    """
    prefixes = log.prefixes_by_purpose if rule.tool_choice else log.prefixes
    life = inf if rule.life is None or log.seconds is None or log.seconds <= rule.life else rule.life
    key = prefixes is log.prefixes, rule.marks, rule.lookback, rule.replies, life, places
    if key not in log.remembered:
        cache, found = Cache(prefixes, rule, places, life), list[tuple[int, int]]()
        for at, request in enumerate(log.requests):
            found.append(cache.look_up(at, request.units, request.stable, request.prompt, request.at or 0.0))
            cache.store_reply(at, request.at or 0.0)
        log.remembered[key] = found
    of_each: Sequence[tuple[int, int]] = log.remembered[key]
    return of_each
