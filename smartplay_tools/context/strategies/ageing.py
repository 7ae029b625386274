"""Ageing: what happens to turns older than `history`. They are dropped, or stay with observations masked.

Age is measured in steps. A model that plays no step would therefore see an ever longer past: its turns never become
older. If the budget limits `stalled_turns`, turns without a step age by their number instead: of several such turns in
a row only the newest are kept.
"""

from __future__ import annotations

from smartplay_tools.context.prompts.wording import Wording
from smartplay_tools.context.strategies.base import BudgetStrategy, boundary
from smartplay_tools.context.tokens import TokenCounter
from smartplay_tools.types import Budget


class Ageing(BudgetStrategy):
    """Drops what is too old, or masks it. Every window has this strategy; a budget asks for masking."""

    name = "beyond_history"
    option_help = "Turns older than --history: drop, or mask (kept, without observations)."

    def __init__(self, budget: Budget, counter: TokenCounter, words: Wording) -> None:
        self.drops = drops_old_turns(budget)
        """Whether a turn that is older than the history ends the selection."""
        self._moved = boundary(0 if self.drops and not words.has_grid else budget.slack, words)

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

        With slack it moves in blocks, as a window does.
        """
        return 0 if history is None else self._moved(step, history, before)


def drops_old_turns(budget: Budget) -> bool:
    """Whether turns that are older than the history are dropped."""
    return budget.beyond_history == "drop"


def turns_leave(budget: Budget, history: int | None) -> bool:
    """Whether turns ever leave a window, because they are too old or the prompt is full; `history` is in numbers."""
    return budget.prompt_tokens is not None or (history is not None and drops_old_turns(budget))
