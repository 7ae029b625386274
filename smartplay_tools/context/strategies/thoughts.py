"""Thoughts: what an agent said and reasoned leaves before its calls do, once the turn is old."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from smartplay_tools.context.prompts.wording import Wording
from smartplay_tools.context.strategies.base import BudgetStrategy, boundary
from smartplay_tools.context.tokens import TokenCounter
from smartplay_tools.context.view import Selection
from smartplay_tools.types import Budget

NONE = -1
"""The limit with which the newest reply, too, is older than the last that keeps its words."""


class Thoughts(BudgetStrategy):
    """Shows older turns with their calls and results, and without the words and the reasoning of their replies."""

    name = "own_words"
    option_help = (
        "Past steps whose replies keep their words and reasoning; older ones have their calls alone. never: all have."
    )

    def __init__(self, budget: Budget, counter: TokenCounter, words: Wording) -> None:
        assert budget.own_words is not None
        self._limit = NONE if budget.own_words == "never" else budget.own_words
        self._moved = boundary(0 if self._limit is NONE else budget.slack, words)

    def recorded(self, chosen: Selection) -> Mapping[str, Any]:
        """Return w."""
        return {"words": chosen.trimmed_before}

    def trimmed_before(self, step: int, before: int) -> int:
        """Return w: replies of turns older than this are trimmed at a step; `before` is w before the latest turn."""
        return self._moved(step, self._limit, before)
