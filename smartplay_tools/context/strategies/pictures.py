"""Pictures: the newest stay visible, and older observations keep their words alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from smartplay_tools.context.prompts.wording import Wording
from smartplay_tools.context.strategies.base import BudgetStrategy, boundary
from smartplay_tools.context.tokens import TokenCounter
from smartplay_tools.context.view import Selection
from smartplay_tools.types import Budget


class Pictures(BudgetStrategy):
    """Elides all but the newest pictures, whether or not their turns are still shown."""

    name = "newest_pictures"
    option_help = "The number of newest pictures that stay visible; older observations keep their words alone."

    def __init__(self, budget: Budget, counter: TokenCounter, words: Wording) -> None:
        assert budget.newest_pictures is not None
        self._past, self._moved = budget.newest_pictures - 1, boundary(budget.slack, words)

    @classmethod
    def refused_form(cls, observation: str) -> str | None:
        """Return why it does nothing where observations are words."""
        if observation == "text":
            return 'newest_pictures has nothing to leave out where observations are words; use observation="both".'
        return None

    def recorded(self, chosen: Selection) -> Mapping[str, Any]:
        """Return p."""
        return {"pictures": chosen.elided}

    def elided(self, shown: int, before: int) -> int:
        """Return p: of the `shown` pictures so far, the first p are elided; `before` is p before the latest turn."""
        return self._moved(shown - 1, self._past, before) if shown else 0
