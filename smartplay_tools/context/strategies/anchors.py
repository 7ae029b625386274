"""Anchors: the first turns of an episode stay visible when later ones leave."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from smartplay_tools.context.prompts.wording import Wording
from smartplay_tools.context.strategies.ageing import turns_leave
from smartplay_tools.context.strategies.base import BudgetStrategy
from smartplay_tools.context.tokens import TokenCounter
from smartplay_tools.context.view import Selection
from smartplay_tools.types import Budget


class Anchors(BudgetStrategy):
    """Pins as many of the first turns as fit beside what is pinned in any case."""

    name = "first_turns"
    option_help = "The number of first turns that stay visible when later ones leave, as far as they fit."

    def __init__(self, budget: Budget, counter: TokenCounter, words: Wording) -> None:
        assert budget.first_turns is not None
        self.first_turns = budget.first_turns

    def recorded(self, chosen: Selection) -> Mapping[str, Any]:
        """Return how many of them stay."""
        return {"anchors": chosen.facts.get("anchors", 0)}

    @classmethod
    def refusal(cls, budget: Budget, history: int | None) -> str | None:
        """Return why nothing can be anchored: no turn ever leaves."""
        if not turns_leave(budget, history):
            return "first_turns has nothing to keep where no turn ever leaves; give prompt_tokens a number."
        return None
