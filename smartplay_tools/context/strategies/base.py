"""The base class of strategies, and the tools that a strategy can add."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, ClassVar

from smartplay_tools.context.prompts.wording import Wording
from smartplay_tools.context.tokens import TokenCounter
from smartplay_tools.context.turns import Turn
from smartplay_tools.types import STRATEGIES, Budget, ToolSpec


@dataclass(frozen=True)
class ToolAnswer:
    """The answer to a call of a strategy's tool."""

    text: str
    data: Mapping[str, Any] = field(default_factory=dict)
    """The data of the result, which the record keeps."""
    is_cut: bool | None = None
    """Whether the text was cut to a cap of its own; None if the cap is that of all results."""
    mistake: str | None = None
    """The kind of mistake, if the call is refused; `text` is then the reason."""


@dataclass(frozen=True)
class StrategyTool:
    """A tool that a strategy adds."""

    spec: ToolSpec
    argument: str | None
    """The name of its only argument, a text; None if it reads its arguments itself."""
    usage: str
    """How to call it, for errors."""
    answer: Callable[[Any], ToolAnswer]
    """Answers a call, given the text, or all arguments."""


class BudgetStrategy:
    """One way to deal with the past, in one episode. A method that is not overridden changes nothing."""

    name: ClassVar[str]
    """The field of `Budget` that asks for it."""
    option_help: ClassVar[str]
    """The help of the command-line option with that name."""
    reserve = 0
    """The tokens that a window leaves free when it moves."""
    tools: Sequence[StrategyTool] = ()
    """The tools that it adds."""

    def __init__(self, budget: Budget, counter: TokenCounter, words: Wording) -> None:
        """Set it up for one episode."""

    @classmethod
    def is_asked_for(cls, budget: Budget) -> bool:
        """Whether a budget asks for it."""
        return bool(getattr(budget, cls.name) != STRATEGIES[cls.name])

    @classmethod
    def refusal(cls, budget: Budget, history: int | None) -> str | None:
        """Return why a budget that asks for it cannot be enforced, in one sentence; None if it can be.

        `history` is the budget's in numbers.
        """
        return None

    @classmethod
    def refused_form(cls, observation: str) -> str | None:
        """Return why a budget cannot ask for it where this is what observations are; None if it can."""
        return None

    def pinned(self, turn: Turn) -> int | None:
        """Return the turn to pin after this one, with its observations masked, where it fits; None for none."""
        return None


def moved(step: int, before: int, limit: int, share: Fraction | int) -> int:
    """Return a boundary at most `limit` behind a step; with slack it stays at `before` until it has to, then jumps."""
    if share == 1:
        return max(0, step - limit)
    return before if step - before <= limit else step - math.ceil(share * limit)


def share_kept(slack: float) -> Fraction | int:
    """Return 1 - slack, read as a decimal: in floats, ceil((1 - .7) x 10) is 4. Without slack it is the integer 1."""
    return 1 - Fraction(str(slack)) if slack else 1
