"""The requests of an episode as a cache sees them: sequences of units, and the prefixes that they have in common.

The units of a request are the tools as one, then each message. Inside the first unit that differs nothing is common: a
head to which the manual is added counts as new from there on. Priming belongs to no unit, since no request shares it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from typing import Any, NamedTuple

from smartplay_tools.types import Purpose


class Unit(NamedTuple):
    """The tools of a request, or one of its messages; equal ones are the same object."""

    number: int
    tokens: int
    blocks: int
    """Content blocks: a text, a call, a result and the reasoning of a reply are one each."""
    is_system: bool
    """Whether it is the tools or a system message."""


class Request(NamedTuple):
    """A prompt that had a reply. Tokens are the provider's where it counted them, else budget tokens."""

    units: Sequence[Unit]
    """The tools and the messages, in budget tokens."""
    same: int
    """How many units at the beginning are the same as in the previous request."""
    stable: int
    """How many units end with the last message that is unchanged since the request before; 0 if none is."""
    purpose: Purpose
    prompt: int
    """Tokens of the prompt, priming included."""
    reply: int
    """Tokens of the reply."""
    answer: Unit
    """The reply as a unit of later requests."""
    score: float
    """The score when it was sent."""
    at: float | None
    """When it was sent, in seconds, if the times of the record were kept."""


@dataclass(frozen=True)
class RequestLog:
    """The requests of an episode, in order."""

    requests: Sequence[Request]
    ratio: Fraction | None
    """The provider's tokens of a prompt to a budget token; None if the provider counted none."""
    remembered: dict[Any, Any] = field(default_factory=dict, init=False, repr=False, compare=False)
    """Results shared by rules that store the same prefixes, by what they store."""

    @cached_property
    def columns(self) -> tuple[list[int], list[int], list[float]]:
        """The tokens of the prompts and of the replies, and the scores."""
        requests = self.requests
        return [each.prompt for each in requests], [each.reply for each in requests], [each.score for each in requests]

    @cached_property
    def seconds(self) -> float | None:
        """The seconds from the first request to the last; None if the times are not known."""
        times = [each.at for each in self.requests if each.at is not None]
        return max(times, default=0.0) - min(times, default=0.0) if len(times) == len(self.requests) else None

    @cached_property
    def prefixes(self) -> Prefixes:
        """The prefixes of the requests."""
        return self._numbered(by_purpose=False)

    @cached_property
    def prefixes_by_purpose(self) -> Prefixes:
        """The same, where requests with different purposes have only their tools and system messages in common."""
        if all(request.purpose == "play" for request in self.requests):
            return self.prefixes
        return self._numbered(by_purpose=True)

    def _numbered(self, *, by_purpose: bool) -> Prefixes:
        tagged: dict[tuple[Unit, Purpose], Unit] = {}

        def told_apart(units: Sequence[Unit], purpose: Purpose) -> list[Unit]:
            return [tagged.setdefault((unit, purpose), unit._replace(number=-1 - len(tagged))) for unit in units]

        prefixes = Prefixes(self.ratio)
        for request in self.requests:
            units, same, answer = request.units, request.same, request.answer
            if by_purpose:
                system = next((at for at, unit in enumerate(units) if not unit.is_system), len(units))
                units, same = [*units[:system], *told_apart(units[system:], request.purpose)], min(same, system)
                [answer] = told_apart([answer], request.purpose)
            prefixes.add(units, same, answer)
        return prefixes


class Prefixes:
    """The prefixes of requests that end with a unit, each with a number; equal ones have the same.

    They form a tree: each prefix extends another by one unit. The empty prefix is 0. A prefix has the number after that
    of the one it extends, unless that one was extended by another unit before.
    """

    def __init__(self, ratio: Fraction | None = None) -> None:
        """`ratio` is that of the provider's tokens to ours."""
        self.paths: list[list[int]] = []
        """For each request its prefixes, by their length in units."""
        self.shared: list[int] = []
        """For each request, how many of its units an earlier one begins with."""
        self.shared_with_reply: list[int] = []
        """For each request, how many of its units an earlier one, or one with its reply, begins with."""
        self.answers: list[int] = []
        """For each request the prefix that is itself with its reply."""
        self._ratio = ratio
        self._before = [0]
        """Each prefix without its last unit."""
        self._units: list[Unit] = [Unit(-1, 0, 0, is_system=False)]
        """The last unit of each prefix."""
        self._branches: dict[tuple[int, int], int] = {}
        """The prefixes whose number is not the next, by the one before and the last unit."""
        self._replies: set[int] = set()
        """The prefixes that end with a reply, and with which no request begins."""

    def add(self, units: Sequence[Unit], same: int, answer: Unit) -> None:
        """Add the next request, whose first units are the `same` as those of the one before."""
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
        if (prefix := self._after(path[-1], answer)) is None:
            [prefix] = self._grown(path[-1], [answer])
            self._replies.add(prefix)
        self.answers.append(prefix)

    def _after(self, prefix: int, unit: Unit) -> int | None:
        """The prefix that is this one and a unit, if there is one."""
        following = prefix + 1
        if following < len(self._units) and self._before[following] == prefix and self._units[following] is unit:
            return following
        return self._branches.get((prefix, unit.number))

    def _grown(self, prefix: int, units: Sequence[Unit]) -> Sequence[int]:
        """Number the prefixes that extend one by each of these units in turn."""
        first = len(self._units)
        if units and first != prefix + 1:
            self._branches[prefix, units[0].number] = first
        new = range(first, first + len(units))
        self._before += (prefix, *new)[: len(units)]
        self._units += units
        return new

    @cached_property
    def tokens(self) -> list[int]:
        """The tokens of each prefix, which are the provider's if there is a ratio."""
        tokens = self._summed([unit.tokens for unit in self._units])
        if (ratio := self._ratio) is None:
            return tokens
        return [each * ratio.numerator // ratio.denominator for each in tokens]

    @cached_property
    def blocks(self) -> list[int]:
        """The content blocks of each prefix; tools are none."""
        return self._summed([unit.blocks for unit in self._units])

    def _summed(self, sizes: Sequence[int]) -> list[int]:
        sums: list[int] = []
        for before, size in zip(self._before, sizes, strict=True):
            sums.append(size + sums[before] if sums else size)
        return sums
