"""What requests cost under the rule of a cache: the definition of hits, writes and cost, as a function of a record.

A figure of this kind is a model of a bill. It leaves out what a record cannot know: entries of other episodes, repeated
attempts at a reply, and evictions before an entry's life is over. The first makes a bill smaller, the others larger.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import fsum, inf
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
    life = rule.life if knows_times else None
    stored = _stored_whole(log, rule, life) if rule.marks == "auto" else _stored_to_marks(log, rule, life, marks)
    calls = []
    block, minimum, writes = rule.block, rule.minimum, rule.write is not None
    for request, (length, last) in zip(log.requests, stored, strict=True):
        hit = min(request.ends[length], request.prompt - 1)
        hit -= hit % block
        if hit < minimum:
            hit = 0
        last -= last % block
        written = last - hit if writes and last >= minimum and last > hit else 0
        calls.append(ChargedCall(request.prompt, hit, written, request.reply))
    return calls


def _stored_whole(log: RequestLog, rule: CacheRule, life: float | None) -> Iterator[tuple[int, int]]:
    """Yield for each request the length of its longest stored prefix, in units, and how many of its tokens are stored.

    Where a prefix is stored, all that it begins with are, and were used no earlier, so that the longest is found by
    bisection.
    """
    used: dict[int, float] = {}
    paths, answers = log.paths(by_purpose=rule.tool_choice)
    for request, path, answer in zip(log.requests, paths, answers, strict=True):
        now = request.at or 0.0
        if life is None:
            length = bisect_left(path, True, key=lambda prefix: prefix not in used)
            used.update(dict.fromkeys(path[length:], now))
        else:
            length = bisect_left(path, True, key=lambda prefix: now - used.get(prefix, -inf) > life)
            used.update(dict.fromkeys(path, now))
        if rule.replies:
            used[answer] = now
        yield length, request.prompt


def _stored_to_marks(
    log: RequestLog, rule: CacheRule, life: float | None, places: Sequence[Place]
) -> Iterator[tuple[int, int]]:
    """Yield the same where requests are stored up to their marks.

    A stored prefix is looked for at each mark, from the last one on, and at most `lookback` blocks before it.
    """
    used: dict[int, float] = {}
    """The stored prefixes by their numbers, with the time of their last use."""
    paths, answers = log.paths(by_purpose=rule.tool_choice)
    minimum, longest_life = rule.minimum, inf if life is None else life
    lookback = inf if rule.lookback is None else rule.lookback
    for request, path, answer in zip(log.requests, paths, answers, strict=True):
        now, ends, blocks = request.at or 0.0, request.ends, request.blocks
        marks = _marked(request, rule, places)
        length = 0
        for mark in reversed(marks):
            farthest = max(length, bisect_left(blocks, blocks[mark] - lookback) - 1)
            for at in range(mark, farthest, -1):
                prefix = path[at - 1]
                if prefix in used and now - used[prefix] <= longest_life:
                    length = at
                    break
        if length:
            used[path[length - 1]] = now
        for mark in marks:
            if ends[mark] >= minimum:
                used[path[mark - 1]] = now
        if rule.replies and request.answered >= minimum:
            used[answer] = now
        yield length, ends[marks[-1]] if marks else 0


def _marked(request: Request, rule: CacheRule, places: Sequence[Place]) -> Sequence[int]:
    """The numbers of units after which a request is marked."""
    stable, end = request.stable, len(request.units)
    marks = [stable] if "stable" in places and 0 < stable < end else []
    if "end" in places or ("stable" in places and stable == end):
        marks.append(end)
    assert isinstance(rule.marks, int)
    return marks[-rule.marks :] if rule.marks else []
