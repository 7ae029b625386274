"""Strategies: what becomes of the past, one class for each way to deal with it.

Each is a class in a file of its own: the field of `Budget` that asks for it, what it refuses, the tools it adds, the
tokens it reserves, what it hides, pins or asks for. `Strategies` creates the objects of one episode and combines them;
the window and the episode ask it, not the classes. To add one, write its class, list it in `KINDS` and add its field to
`Budget`.

All strategies, and those of one episode, which act together.
"""

from __future__ import annotations

from smartplay_tools.context.strategies.ageing import Ageing, drops_old_turns, turns_leave
from smartplay_tools.context.strategies.anchors import Anchors
from smartplay_tools.context.strategies.base import BudgetStrategy, StrategyTool, ToolAnswer, share_kept
from smartplay_tools.context.strategies.choices import Choice, Past, PastTurn, Strategy
from smartplay_tools.context.strategies.custom import (
    Custom,
    load_strategy,
    make_strategy,
    recorded_strategy,
    register_strategy,
)
from smartplay_tools.context.strategies.memory import MemoryFiles, is_memory_tool
from smartplay_tools.context.strategies.notes import Notes
from smartplay_tools.context.strategies.offload import Offload
from smartplay_tools.context.strategies.pictures import Pictures
from smartplay_tools.context.strategies.recall import Recall
from smartplay_tools.context.strategies.summaries import Summaries, Summary, summaries_of
from smartplay_tools.context.strategies.thoughts import Thoughts
from smartplay_tools.context.tokens import TokenCounter
from smartplay_tools.context.turns import Turn
from smartplay_tools.types import Budget

__all__ = [
    "KINDS",
    "BudgetStrategy",
    "Choice",
    "Past",
    "PastTurn",
    "Strategies",
    "Strategy",
    "StrategyTool",
    "Summaries",
    "Summary",
    "ToolAnswer",
    "drops_old_turns",
    "is_memory_tool",
    "load_strategy",
    "refusal",
    "register_strategy",
    "share_kept",
    "summaries_of",
    "turns_leave",
]


KINDS: tuple[type[BudgetStrategy], ...] = (
    Ageing, Notes, Summaries, Thoughts, Anchors, Recall, Offload, MemoryFiles, Pictures, Custom,
)  # fmt: skip
"""Every strategy, in the order in which they are asked."""


class Strategies:
    """The strategies of one episode: those that its budget asks for, as objects of its own."""

    def __init__(self, budget: Budget, counter: TokenCounter) -> None:
        asked = [kind(budget, counter) for kind in KINDS if kind.is_asked_for(budget)]
        self.ageing = Ageing(budget, counter)
        """What becomes of turns that are too old."""
        self.summaries = next((strategy for strategy in asked if isinstance(strategy, Summaries)), None)
        """The strategy that asks for summaries when turns leave; None without it."""
        self.thoughts = next((strategy for strategy in asked if isinstance(strategy, Thoughts)), None)
        """The strategy that strips old replies of their words; None without it."""
        self.pictures = next((strategy for strategy in asked if isinstance(strategy, Pictures)), None)
        """The strategy that leaves out older pictures; None without it."""
        self.anchors = next((strategy.most for strategy in asked if isinstance(strategy, Anchors)), 0)
        """How many of the first turns stay, as far as they fit."""
        self.recall = next((strategy for strategy in asked if isinstance(strategy, Recall)), None)
        """The strategy that searches observations that have left; None without it."""
        self.offload = next((strategy for strategy in asked if isinstance(strategy, Offload)), None)
        """The strategy that keeps the rest of observations that are too long; None without it."""
        self.memory = next((strategy for strategy in asked if isinstance(strategy, MemoryFiles)), None)
        """The strategy that keeps the agent's files; None without it."""
        self.tools = tuple(tool for strategy in asked for tool in strategy.tools)
        """The tools that they add."""
        self.reserve = sum(strategy.reserve for strategy in asked)
        """R: the tokens that a window leaves free when it moves."""
        self.reserved_for = ", ".join(f"{s.name}={getattr(budget, s.name)}" for s in asked if s.reserve)
        """The fields of the budget that need the reserve."""
        self.custom: Strategy | None = None
        """The custom strategy that chooses the turns, once it is loaded; None where the window does."""
        self._name = budget.strategy
        self._pinning = [strategy for strategy in asked if type(strategy).pinned is not BudgetStrategy.pinned]

    def load_custom(self, digest: str | None, *, is_recorded: bool) -> None:
        """Make the custom strategy that the budget names, if it names one; `digest` is that of its file.

        With `is_recorded` nothing is imported that the user has not named.
        """
        if self._name is not None:
            loaded = (recorded_strategy if is_recorded else load_strategy)(self._name, digest)
            self.custom = make_strategy(self._name, loaded)

    def pinned(self, turn: Turn) -> int | None:
        """Return the turn to pin after this one; None for none."""
        for strategy in self._pinning:
            if (pinned := strategy.pinned(turn)) is not None:
                return pinned
        return None


def refusal(budget: Budget, history: int | None, observation: str) -> str | None:
    """Return why what a budget asks for cannot be enforced, in one sentence.

    `history` is the budget's in numbers, and `observation` what observations are.
    """
    asked = [kind for kind in KINDS if kind.is_asked_for(budget)]
    reasons = (kind.refusal(budget, history) or kind.refused_form(observation) for kind in asked)
    return next((reason for reason in reasons if reason is not None), None)
