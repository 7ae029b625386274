"""What a provider's cache sees of requests: sequences of units, the prefixes that they share, and what it finds again.

Equal units have the same number. The units of a request are the tools as one, then each message. Inside the first unit
that differs nothing is common: a head to which the manual is added counts as new from there on. Priming belongs to no
unit, since no request shares it. `docs/context-cost.md` is the definition.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Hashable, Mapping, Sequence
from fractions import Fraction
from functools import cached_property
from math import inf
from typing import Any, Literal, NamedTuple, get_args

from smartplay_tools.context.prefix import common_beginning
from smartplay_tools.context.tokens import TokenCounter
from smartplay_tools.context.turns import Form
from smartplay_tools.providers.caches import CacheRule
from smartplay_tools.transcript.hashing import canonical_json, tools_bytes
from smartplay_tools.types import Purpose, ToolSpec
from smartplay_tools.types.messages import Message, calls_of, reasoning_of, text_of

Place = Literal["stable", "end"]
"""Where a player marks a prompt: at the end of what is unchanged since the prompt before, or at its own end."""

PLACES: tuple[Place, ...] = get_args(Place)


class Unit(NamedTuple):
    """The tools of a request, or one of its messages; equal ones are the same object."""

    number: int
    tokens: int
    blocks: int
    """Content blocks: a text, a call, a result and the reasoning of a reply are one each."""
    is_system: bool
    """Whether it is the tools or a system message."""


class Units(dict[Form, Unit]):
    """The units of requests by the forms of their messages; equal ones are numbered and counted once."""

    def __init__(self, counter: TokenCounter) -> None:
        super().__init__()
        self._counter = counter
        self._known: dict[Hashable, Unit] = {}

    def __missing__(self, form: Form) -> Unit:
        unit = self[form] = self.of(form.message)
        return unit

    def of(self, message: Message) -> Unit:
        """Return the unit of a message."""
        key = _written(message)
        if (unit := self._known.get(key)) is None:
            tokens, is_system = self._counter.message(message), message["role"] in ("system", "developer")
            unit = self._known[key] = Unit(len(self._known), tokens, _blocks_of(message), is_system)
        return unit

    def tools(self, tools: Sequence[ToolSpec]) -> Unit:
        """Return the unit of a request's tools."""
        key = tools_bytes(tools)
        if (unit := self._known.get(key)) is None:
            unit = self._known[key] = Unit(len(self._known), self._counter.tools(tools), 0, is_system=True)
        return unit


class Prefixes:
    """The prefixes of requests that end with a unit, each with a number; equal ones have the same.

    They form a tree: each prefix extends another by one unit. The empty prefix is 0.
    """

    def __init__(self, ratio: Fraction | None = None, *, by_purpose: bool = False) -> None:
        """`ratio` is that of the provider's tokens to ours.

        With `by_purpose`, requests with different purposes have only their tools and system messages in common.
        """
        self.paths: list[list[int]] = []
        """For each request its prefixes, by their length in units."""
        self.shared: list[int] = []
        """For each request, how many of its units an earlier one begins with."""
        self.shared_with_reply: list[int] = []
        """For each request, how many of its units an earlier one, or one with its reply, begins with."""
        self.answers: list[int] = []
        """For each request the prefix that is itself with its reply."""
        self._ratio, self._by_purpose = ratio, by_purpose
        self._tagged: dict[tuple[Unit, Purpose], Unit] = {}
        self._longer: dict[tuple[int, int], int] = {}
        """The prefix that is another one and a unit, by that one and the unit's number."""
        self._replies: set[int] = set()
        """The prefixes that end with a reply, and with which no request begins."""
        self.blocks = [0]
        """The content blocks of each prefix; tools are none."""
        self._tokens = [0]

    def add(self, units: Sequence[Unit], same: int, purpose: Purpose = "play") -> None:
        """Add the next request, whose first units are the `same` as those of the one before."""
        if self._by_purpose:
            system = next((at for at, unit in enumerate(units) if not unit.is_system), len(units))
            own = [self._told_apart(unit, purpose) for unit in units[system:]]
            units, same = [*units[:system], *own], min(same, system)
        path = self.paths[-1][: same + 1] if self.paths else [0]
        for unit in units[same:]:
            if (prefix := self._after(path[-1], unit)) is None:
                break
            path.append(prefix)
        shared = len(path) - 1
        self.shared_with_reply.append(shared)
        self.shared.append(shared - (path[shared] in self._replies))  # nothing follows a reply that was not shown again
        self._replies.discard(path[shared])
        path += self._grown(path[shared], units[shared:])
        self.paths.append(path)

    def add_reply(self, answer: Unit, purpose: Purpose = "play") -> None:
        """Add the reply to the latest request."""
        if self._by_purpose:
            answer = self._told_apart(answer, purpose)
        path = self.paths[-1]
        if (prefix := self._after(path[-1], answer)) is None:
            [prefix] = self._grown(path[-1], [answer])
            self._replies.add(prefix)
        self.answers.append(prefix)

    def _told_apart(self, unit: Unit, purpose: Purpose) -> Unit:
        return self._tagged.setdefault((unit, purpose), unit._replace(number=-1 - len(self._tagged)))

    def _after(self, prefix: int, unit: Unit) -> int | None:
        """The prefix that is this one and a unit, if there is one."""
        return self._longer.get((prefix, unit.number))

    def _grown(self, prefix: int, units: Sequence[Unit]) -> Sequence[int]:
        """Number the prefixes that extend one by each of these units in turn."""
        new = range(len(self._tokens), len(self._tokens) + len(units))
        for unit, before, number in zip(units, (prefix, *new), new, strict=False):
            self._longer[before, unit.number] = number
            self._tokens.append(self._tokens[before] + unit.tokens)
            self.blocks.append(self.blocks[before] + unit.blocks)
        return new

    @cached_property
    def tokens(self) -> list[int]:
        """The tokens of each prefix, the provider's if there is a ratio, once all requests have been added."""
        if (ratio := self._ratio) is None:
            return self._tokens
        return [each * ratio.numerator // ratio.denominator for each in self._tokens]


class Cache:
    """What a provider with this rule has stored of requests, which are looked up in their order."""

    def __init__(self, prefixes: Prefixes, rule: CacheRule, places: Sequence[Place], life: float = inf) -> None:
        """`places` say where the player marks its prompts, for rules that store only up to marks."""
        self._prefixes, self._rule, self._places, self._life = prefixes, rule, places, life
        self._lookback = inf if rule.lookback is None else rule.lookback
        self._used: dict[int, float] = {}
        """The stored prefixes by their numbers, with the time of their last use."""

    def look_up(self, at: int, units: Sequence[Unit], stable: int, prompt: int, now: float = 0.0) -> tuple[int, int]:
        """Return how many tokens of a request are found stored, and how many are stored after it.

        `prompt` are its tokens, of which the last one is always computed.
        """
        path, tokens = self._prefixes.paths[at], self._prefixes.tokens
        if self._rule.marks == "auto":
            length, stored = self._find_whole(at, now), prompt
        else:
            marks = marked(units, stable, self._rule.marks, self._places)
            length, stored = self._find_marked(at, marks, now), tokens[path[marks[-1]]] if marks else 0
        return min(tokens[path[length]], prompt - 1), stored

    def _find_whole(self, at: int, now: float) -> int:
        """The length in units of the longest stored prefix, where requests are stored whole.

        Where a prefix is stored, all that it begins with are, and were used no earlier, so that the longest is found by
        bisection.
        """
        prefixes, used = self._prefixes, self._used
        if self._life == inf:
            return (prefixes.shared_with_reply if self._rule.replies else prefixes.shared)[at]
        path = prefixes.paths[at]
        length = bisect_left(path, True, lo=1, key=lambda prefix: now - used.get(prefix, -inf) > self._life) - 1
        used.update(dict.fromkeys(path, now))
        return length

    def _find_marked(self, at: int, marks: Sequence[int], now: float) -> int:
        """The same where a request is stored up to its marks, and looked for at most `lookback` blocks before them."""
        path, shared = self._prefixes.paths[at], self._prefixes.shared_with_reply[at]
        blocks, used, longest = self._prefixes.blocks, self._used, 0
        for mark in reversed(marks):
            farthest = blocks[path[mark]] - self._lookback
            for length in range(min(mark, shared), longest, -1):
                prefix = path[length]
                if blocks[prefix] < farthest:
                    break
                if prefix in used and now - used[prefix] <= self._life:
                    longest = length
                    break
        for length in (longest, *marks):
            used[path[length]] = now
        return longest

    def store_reply(self, at: int, now: float = 0.0) -> None:
        """Store a request with its reply, if the rule does so."""
        if self._rule.replies:
            self._used[self._prefixes.answers[at]] = now


def hit_and_written(found: int, stored: int, rule: CacheRule) -> tuple[int, int]:
    """Return the tokens that are charged as read and as written, in whole blocks; fewer than the minimum are none."""
    hit, kept = (length - length % rule.block for length in (found, stored))
    hit = hit if hit >= rule.minimum else 0
    kept = kept if kept >= rule.minimum and rule.write is not None else 0
    return hit, max(0, kept - hit)


def marked(units: Sequence[Unit], stable: int, most: int, places: Sequence[Place]) -> Sequence[int]:
    """Return the numbers of units after which a request is marked; of the marks the last ones count."""
    end = len(units)
    wanted = [stable] if "stable" in places and 0 < stable < end else []
    if "end" in places or ("stable" in places and stable == end):
        wanted.append(end)
    return wanted[-most:] if most else []


def marks_of(player_options: Mapping[str, Any]) -> Sequence[Place]:
    """Return where a player with these options marks its prompts for a cache."""
    match player_options.get("cache", True):
        case "stable":
            return ("stable",)
        case False:
            return ()
    return PLACES


def same_and_stable(units: Sequence[Unit], before: Sequence[Unit]) -> tuple[int, int]:
    """Return how many units are the same as in the request before, and how many end with its last unchanged message."""
    same = common_beginning(units, before)
    # Messages after the tools are stable even if the tools change.
    stable = same or 1 + common_beginning(units[1:], before[1:])
    return same, stable if stable > 1 else 0


def _written(message: Message) -> Hashable:
    """Return a key that is equal if the canonical JSON of messages is; for most results it needs no JSON."""
    if message["role"] == "tool" and len(message) == 3 and isinstance(message["content"], str):
        return message["content"], message["tool_call_id"]
    return canonical_json(message)


def _blocks_of(message: Message) -> int:
    """Return how many content blocks a message is: a text, a call, a result and its reasoning are one each."""
    if message["role"] != "assistant":
        return 1
    return max(1, bool(text_of(message)) + len(calls_of(message)) + bool(reasoning_of(message)))
