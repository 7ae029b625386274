"""The tokens and cost that episodes have used, added up."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

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


def _sum(one: Any, other: Any) -> Any:
    return None if one is None or other is None else one + other
