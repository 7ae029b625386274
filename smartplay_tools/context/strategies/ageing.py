"""Ageing: what becomes of turns that are older than `history`. They are dropped, or stay with observations masked."""

from __future__ import annotations

import math

from smartplay_tools.context.strategies.base import Strategy, share_kept
from smartplay_tools.tokens import TokenCounter
from smartplay_tools.types import Budget


class Ageing(Strategy):
    """Drops what is too old, or masks it. Every window has this strategy; a budget asks for masking."""

    name = "beyond_history"
    option_help = "Turns older than --history: drop, or mask (kept, without observations)."

    def __init__(self, budget: Budget, counter: TokenCounter) -> None:
        self.drops = drops_old_turns(budget)
        """Whether a turn that is older than the history ends the selection."""
        self._share = share_kept(budget.slack)

    @classmethod
    def refusal(cls, budget: Budget, history: int | None) -> str | None:
        """Return why masking cannot be enforced: without a history nothing is masked."""
        if history is None:
            return (
                'beyond_history="mask" without a history masks nothing; give history a number, or leave it at "drop".'
            )
        return None

    def oldest(self, step: int, history: int | None, before: int) -> int:
        """Return b, the oldest observation that is not masked at a step; `before` is b before the latest turn.

        With masking and slack it moves in blocks, as a window does.
        """
        if history is None:
            return 0
        if self.drops or self._share == 1:
            return max(0, step - history)
        return before if step - before <= history else step - math.ceil(self._share * history)


def drops_old_turns(budget: Budget) -> bool:
    """Whether turns that are older than the history are dropped."""
    return budget.beyond_history == "drop"
