"""The tokens and cost that episodes have used, added up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from operator import add
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
        return self._with(other, add)

    def __sub__(self, other: Spent) -> Spent:
        return self._with(other, lambda mine, theirs: round(mine - theirs, DIGITS))

    def _with(self, other: Spent, combine: Callable[[Any, Any], Any]) -> Spent:
        """The sums of both; a figure that one of them does not know is unknown in the sum."""
        pairs = {name: (mine, vars(other)[name]) for name, mine in vars(self).items()}
        both: dict[str, Any] = {name: None if None in pair else combine(*pair) for name, pair in pairs.items()}
        return Spent(**both)
