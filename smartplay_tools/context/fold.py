"""The fold: how a window with slack moved under versions 1 and 2 of the prompts, from which their records are rebuilt.

What a prompt showed followed from the one before: it began where that began until a limit was exceeded, and then where
a share of the room and of the history was free. Version 3 has the grid (`context.grid`) in its place.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from fractions import Fraction

from smartplay_tools.context.newest import NewestTurns, Places, Stretches, Tokens, Turns, longest_run, step_of
from smartplay_tools.types import ResolvedBudget


def moved_by_fold(step: int, limit: int, slack: float, before: int) -> int:
    """Return a boundary at most `limit` behind a step; with slack it stays at `before` until it has to, then jumps."""
    if not slack:
        return max(0, step - limit)
    return before if step - before <= limit else step - _kept(limit, slack)


def _kept(limit: int, slack: float) -> int:
    return math.ceil((1 - Fraction(str(slack))) * limit)


class FoldedTurns(NewestTurns):
    """Moves the first turn of the run on, turn by turn, where a budget has slack."""

    def __init__(self, budget: ResolvedBudget, reserve: int, question: int) -> None:
        """`question` is the tokens of the question for a summary."""
        super().__init__(budget, reserve)
        self._question, follow = question, self._follow
        self._stretches = Stretches(follow)
        self._shorter = Stretches(None if follow is None else _kept(follow, budget.slack))

    def append(
        self, turns: Turns, tokens: Tokens, places: Places, *, oldest: int, pinned: int | None, head: int, summary: int
    ) -> None:
        """Move on after the newest of the turns; the arguments are those of the grid."""
        self._stretches.append(turns)
        self._shorter.append(turns)
        last, cap, history, low = len(turns) - 1, self._budget.prompt_tokens, self._budget.history, 0
        oldest_turn = max(bisect_left(turns, oldest, key=step_of), self._stretches.first) if self._drops else 0
        fits = cap is None or tokens(self.first) + self._question + summary <= cap
        self.overflows = False
        if fits and self.first >= oldest_turn:
            return
        if history is not None and self._drops:
            low = min(last, bisect_left(turns, turns[-1].step - _kept(history, self._budget.slack), key=step_of))
            low = max(low, self._shorter.first)
        self.first = low
        if cap is not None:
            pins = tokens(last)
            self.overflows = pins + self._reserve > cap
            most = pins + math.floor((1 - Fraction(str(self._budget.slack))) * (cap - self._reserve - pins))
            self.first = last if self.overflows else longest_run(tokens, most, low, last, pinned)
