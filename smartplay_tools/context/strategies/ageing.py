"""Ageing: what happens to turns older than `history`. They are dropped, or stay with observations masked.

Age is measured in steps. A model that plays no step would therefore see an ever longer past: its turns never become
older. If the budget limits `stalled_turns`, turns without a step age by their number instead: of several such turns in
a row only the newest are kept.
"""

from __future__ import annotations

import math
from fractions import Fraction

from smartplay_tools.context.prompts.wording import Wording
from smartplay_tools.context.strategies.base import BudgetStrategy, moved, share_kept
from smartplay_tools.context.tokens import TokenCounter
from smartplay_tools.types import Budget


class Stretches:
    """Finds, turn by turn, which turns are too old because too many turns without a step follow them."""

    def __init__(self, follow: int | None, share: Fraction | int = 1) -> None:
        """`follow` is how many may follow, None for any number; `share` of them may in a window that moves."""
        self._follow = math.inf if follow is None else follow
        self._follow_after_move = math.inf if follow is None else math.ceil(share * follow)
        self._length = 0
        self.first = self.first_after_move = 0
        """The first turn that is not too old, for a window that stays and for one that moves.

        All earlier turns are too old, or a later turn is.
        """

    def append(self, turn: int, *, has_step: bool) -> None:
        """Take note of the next turn."""
        self._length = 0 if has_step else self._length + 1
        if self._length > self._follow_after_move + 1:
            self.first_after_move = turn - int(self._follow_after_move)
        if self._length > self._follow + 1:
            self.first = turn - int(self._follow)


class Ageing(BudgetStrategy):
    """Drops what is too old, or masks it. Every window has this strategy; a budget asks for masking."""

    name = "beyond_history"
    option_help = "Turns older than --history: drop, or mask (kept, without observations)."

    def __init__(self, budget: Budget, counter: TokenCounter, words: Wording) -> None:
        self.drops = drops_old_turns(budget)
        """Whether a turn that is older than the history ends the selection."""
        self._share = share_kept(budget.slack)
        self._by_turn = self.drops and budget.stalled_turns is not None

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
        return moved(step, before, history, 1 if self.drops else self._share)

    def stretches(self, history: int | None) -> Stretches:
        """Return the object that ages turns without a step; a window that moves has slack."""
        return Stretches(history if self._by_turn else None, self._share)


def drops_old_turns(budget: Budget) -> bool:
    """Whether turns that are older than the history are dropped."""
    return budget.beyond_history == "drop"


def turns_leave(budget: Budget, history: int | None) -> bool:
    """Whether turns ever leave a window, because they are too old or the prompt is full; `history` is in numbers."""
    return budget.prompt_tokens is not None or (history is not None and drops_old_turns(budget))
