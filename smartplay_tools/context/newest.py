"""The built-in rule: of the earlier turns the newest stay, as many as fit and are not too old.

Two rules are absolute: no prompt is longer than `prompt_tokens`, and no observation in it is older than `history`
steps. With slack, the run of turns begins on the grid (`context.grid`). `docs/budgets.md` and `docs/strategies.md` have
the exact definition.

The tokens of a prompt fall as its first turn moves on, except where the run begins to include a turn that a strategy
has pinned: it is masked whole before the run and by age inside it, and a marker can be longer than what it replaces. So
the first turn is searched for in two halves, before and after that turn.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Sequence
from operator import attrgetter
from typing import TypeAlias

from smartplay_tools.context.grid import begun_on_grid, block_of, moved_on_grid
from smartplay_tools.context.turns import Turn
from smartplay_tools.types import ResolvedBudget

Turns: TypeAlias = Sequence[Turn]
Tokens: TypeAlias = Callable[[int], int]
Places: TypeAlias = Sequence[int]

step_of: Callable[[Turn], int] = attrgetter("step")


class Stretches:
    """Finds, turn by turn, which turns are too old because too many turns without a step follow them."""

    def __init__(self, follow: int | None, slack: float = 0) -> None:
        """`follow` is how many may follow, None for any number; with slack it moves on in blocks."""
        self._follow, self._slack, self._length = follow, slack, 0
        self.first = 0
        """The first turn that is not too old. All earlier turns are too old, or a later turn is."""

    def append(self, turns: Turns) -> None:
        """Take note of the newest of the turns."""
        is_step = turns[-1].step > (turns[-2].step if len(turns) > 1 else 0)
        self._length = 0 if is_step else self._length + 1
        if self._follow is not None and (old := moved_on_grid(self._length - 1, self._follow, self._slack)):
            self.first = len(turns) - self._length + old


class NewestTurns:
    """Finds the first turn of the run that a prompt shows, turn by turn."""

    def __init__(self, budget: ResolvedBudget, reserve: int) -> None:
        """`reserve` is R, the tokens that the run leaves free."""
        self._budget, self._reserve, self._drops = budget, reserve, budget.beyond_history == "drop"
        self._stretches = Stretches(self._follow, budget.slack)
        self.first = 0
        """The first turn of the run; all turns from there on are shown."""
        self.overflows = False
        """Whether what every prompt shows does not fit. The run is then the newest turn alone."""

    @property
    def _follow(self) -> int | None:
        """How many turns without a step may follow one; None for any number."""
        return self._budget.history if self._drops and self._budget.stalled_turns is not None else None

    def append(
        self, turns: Turns, tokens: Tokens, places: Places, *, oldest: int, pinned: int | None, head: int, summary: int
    ) -> None:
        """Find the first turn after the newest of the turns.

        Arguments:
            turns: all turns.
            tokens: returns V, the tokens of a prompt whose run begins at a turn, without the summary.
            places: those of the turns on the grid, and that of the next.
            oldest: b, before which observations are masked.
            pinned: the turn that a strategy has pinned.
            head: the tokens of the head.
            summary: the tokens of the summary.
        """
        last, cap, slack = len(turns) - 1, self._budget.prompt_tokens, self._budget.slack
        self._stretches.append(turns)
        low = max(first_young(turns, oldest), self._stretches.first) if self._drops else 0
        self.first, self.overflows = low, False
        if cap is None:
            return
        most = cap - self._reserve
        self.overflows = tokens(last) > most
        low = last if self.overflows else low
        self.first = newest_run(tokens, most, places, block_of(slack, most - head), low, pinned)


def first_young(turns: Turns, oldest: int) -> int:
    """Return the first turn that is not too old, at most the newest."""
    return bisect_left(turns, oldest, hi=len(turns) - 1, key=step_of)


def newest_run(tokens: Tokens, most: float, places: Places, block: int, low: int, pinned: int | None = None) -> int:
    """Return the first turn of the run that a prompt shows, of a game's turns as of an agent's.

    It is the longest that fits of those that may begin on the grid, whose `places` these are, or at `low`; the newest
    turn begins it if nothing else fits.
    """
    return begun_on_grid(places, block, low, longest_run(tokens, most, low, len(places) - 2, pinned))


def longest_run(tokens: Tokens, most: float, low: int, last: int, pinned: int | None) -> int:
    """Return the first turn of the longest run that fits: of those from `low` on to the newest turn, which fits."""

    def first_that_fits(low: int, high: int) -> int:
        return low + bisect_left(range(low, high), x=True, key=lambda at: tokens(at) <= most)

    if pinned is None or pinned < low:
        return first_that_fits(low, last)
    first = first_that_fits(pinned + 1, last)
    if first > pinned + 1 or tokens(pinned) > most:
        return first
    return first_that_fits(low, pinned)
