"""The built-in rule: of the earlier turns the newest stay, as many as fit and are not too old.

Two rules are absolute: no prompt is longer than `prompt_tokens`, and no observation in it is older than `history`
steps. With slack, the first turn stays where it is until a limit is exceeded, and then moves on to where a share of the
room is free. `docs/budgets.md` and `docs/strategies.md` have the exact definition.

The tokens of a prompt fall as its first turn moves on, except where the run begins to include a turn that a strategy
has pinned: it is masked whole before the run and by age inside it, and a marker can be longer than what it replaces. So
the first turn is searched for in two halves, before and after that turn.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Sequence
from operator import attrgetter

from smartplay_tools.context.strategies import Strategies
from smartplay_tools.context.strategies.base import share_kept
from smartplay_tools.context.turns import Turn
from smartplay_tools.types import ResolvedBudget

step_of: Callable[[Turn], int] = attrgetter("step")


class NewestTurns:
    """Moves the first turn of the run that a prompt shows, turn by turn."""

    def __init__(self, budget: ResolvedBudget, strategies: Strategies) -> None:
        self._budget, self._ageing, self._reserve = budget, strategies.ageing, strategies.reserve
        self._question_tokens = 0 if strategies.summaries is None else strategies.summaries.question_tokens
        self._share = share_kept(budget.slack)
        self._stretches = self._ageing.stretches(budget.history)
        self.first = 0
        """The first turn of the run; all turns from there on are shown."""
        self.overflows = False
        """Whether what every prompt shows does not fit. The run is then the newest turn alone."""

    def append(
        self, turns: Sequence[Turn], tokens: Callable[[int], int], *, oldest: int, pinned: int | None, summary: int
    ) -> None:
        """Move on after the newest of the turns.

        Arguments:
            turns: all turns.
            tokens: returns V, the tokens of a prompt whose run begins at a turn, without the summary.
            oldest: b, before which observations are masked.
            pinned: the turn that a strategy has pinned.
            summary: the tokens of the summary.
        """
        last = len(turns) - 1
        self._stretches.append(last, has_step=turns[-1].step > (turns[-2].step if last else 0))
        self.overflows = False
        if self._share != 1 and self._holds(turns, tokens, oldest, summary):
            return
        cap, pins = self._budget.prompt_tokens, tokens(last)
        self.overflows = cap is not None and pins + self._reserve > cap
        self.first = last if self.overflows else self._moved(turns, tokens, pins, pinned)

    def _holds(self, turns: Sequence[Turn], tokens: Callable[[int], int], oldest: int, summary: int) -> bool:
        """Whether the run can stay: it is within the limits, and leaves room to ask for another summary."""
        cap = self._budget.prompt_tokens
        boundary = bisect_left(turns, oldest, key=step_of)
        if self._ageing.drops and self.first < max(boundary, self._stretches.first):
            return False
        return cap is None or tokens(self.first) + self._question_tokens + summary <= cap

    def _moved(self, turns: Sequence[Turn], tokens: Callable[[int], int], pins: int, pinned: int | None) -> int:
        """Return the first turn to keep when others than pinned ones may take a share of the room and of the history.

        `pins` are the tokens of what is pinned.
        """
        history, cap, last, low = self._budget.history, self._budget.prompt_tokens, len(turns) - 1, 0
        if history is not None and self._ageing.drops:
            low = min(last, bisect_left(turns, turns[-1].step - math.ceil(self._share * history), key=step_of))
            low = max(low, self._stretches.first_after_move)
        if cap is None:
            return low
        most = pins + math.floor(self._share * (cap - self._reserve - pins))

        def first_that_fits(low: int, high: int) -> int:
            return low + bisect_left(range(low, high), x=True, key=lambda at: tokens(at) <= most)

        if pinned is None or pinned < low:
            return first_that_fits(low, last)
        first = first_that_fits(pinned + 1, last)
        if first > pinned + 1 or tokens(pinned) > most:
            return first
        return first_that_fits(low, pinned)
