"""The tokens and cost that episodes have used, added up."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from smartplay_tools.records.prices import Price
from smartplay_tools.types import Usage

DIGITS = 12
"""Decimals of a difference in US dollars; further ones are rounding errors."""


@dataclass(frozen=True)
class Spent:
    """The tokens and cost that attempts have used."""

    replies: int = 0
    """Replies that have arrived."""
    prompt_tokens: int = 0
    """Budget tokens of prompts."""
    reply_tokens: int = 0
    """Budget tokens of replies."""
    cost: float | None = 0.0
    """US dollars; None if a provider has counted tokens whose price is not known."""
    unknown_calls: int = 0
    """Calls whose process died before the reply."""
    unknown_tokens: int = 0
    """The most tokens that those calls can have taken, as far as their replies had a cap."""
    unknown_cost: float = 0.0
    """The US dollars for these tokens, if a price is known."""

    @property
    def tokens(self) -> int:
        """The sum of budget tokens, as the caps of a run count them."""
        return self.prompt_tokens + self.reply_tokens

    def __add__(self, other: Spent) -> Spent:
        mine, theirs = vars(self), vars(other)
        return Spent(**{name: _sum(mine[name], theirs[name]) for name in mine})

    def __sub__(self, other: Spent) -> Spent:
        costs = (self.cost, other.cost)
        return Spent(
            self.replies - other.replies,
            self.prompt_tokens - other.prompt_tokens,
            self.reply_tokens - other.reply_tokens,
            None if costs[0] is None or costs[1] is None else round(costs[0] - costs[1], DIGITS),
            self.unknown_calls - other.unknown_calls,
            self.unknown_tokens - other.unknown_tokens,
            round(self.unknown_cost - other.unknown_cost, DIGITS),
        )


@dataclass
class Sum:
    """What the usages of a record add up to so far."""

    replies: int = 0
    prompt_tokens: int = 0
    reply_tokens: int = 0
    costs: list[float] = field(default_factory=list)
    """The cost of each, if there is a price."""
    is_unpriced: bool = False
    """Whether a provider has counted tokens whose price is not known."""

    def add(self, usage: Mapping[str, Any], price: Price | None) -> None:
        """Add a `usage` event."""
        self.replies += "reply" in usage
        self.prompt_tokens += usage.get("prompt", 0)
        self.reply_tokens += usage.get("reply", 0)
        if price is not None:
            self.costs.append(price.cost(usage_of(usage)))
        elif usage["provider"] is not None:
            self.is_unpriced = True

    def spent(self) -> Spent:
        """Return it as a `Spent`."""
        cost = None if self.is_unpriced else float(sum(self.costs))
        return Spent(self.replies, self.prompt_tokens, self.reply_tokens, cost)


def usage_of(event: Mapping[str, Any]) -> Usage:
    """Return the tokens of a `usage` event: the provider's count if there is one, else ours."""
    if event["provider"] is not None:
        return Usage(**event["provider"])
    return Usage(prompt=event["prompt"], reply=event["reply"])


def _sum(one: Any, other: Any) -> Any:
    return None if one is None or other is None else one + other
