"""The base class of strategies, and the tools that a strategy can add."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, TypeAlias

from smartplay_tools.context.fold import moved_by_fold
from smartplay_tools.context.grid import moved_on_grid
from smartplay_tools.context.prompts.wording import Wording
from smartplay_tools.context.tokens import TokenCounter
from smartplay_tools.context.turns import Form, Turn
from smartplay_tools.context.view import Selection, View
from smartplay_tools.types import Budget, ToolSpec


@dataclass(frozen=True)
class ToolAnswer:
    """The answer to a call of a strategy's tool."""

    text: str
    data: Mapping[str, Any] = field(default_factory=dict)
    """The data of the result, which the record keeps."""
    is_cut: bool | None = None
    """Whether the text was cut to its own cap; None if the cap is that of all results."""
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


@dataclass(frozen=True)
class Summary:
    """A summary as it is shown."""

    text: str
    """The agent's words, cut to their cap; empty if nothing can be shown."""
    form: Form
    """The message that shows them after the head."""
    tokens: int
    """The budget tokens of the message."""


class BudgetStrategy:
    """One way to deal with the past, in one episode. What a class does not override changes nothing.

    The methods from `pinned` on are decisions, each of which one strategy of a budget can make (`DECISIONS`).
    """

    name: ClassVar[str]
    """The field of `Budget` that asks for it."""
    option_help: ClassVar[str]
    """The help of the command-line option with that name."""
    records_pin_as = "pinned"
    """The field of a `view` event that has the turn that it pins."""
    reserve = 0
    """The tokens that a window leaves free when it moves."""
    tools: Sequence[StrategyTool] = ()
    """The tools that it adds."""
    first_turns = 0
    """How many of the first turns stay, as far as they fit."""
    question: Form | None = None
    """The last message of a prompt that asks for a summary when turns leave; None: none is asked for."""
    question_tokens = 0

    def __init__(self, budget: Budget, counter: TokenCounter, words: Wording) -> None:
        """Set it up for one episode."""

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

    def check(self, budget: Budget, least: int) -> None:
        """Raise an `InvalidArgumentError` if a prompt cannot hold what it shows.

        `least` counts what every prompt holds, and what is kept free.
        """

    def begin(self, held: Any) -> None:
        """Begin with what its tool held at the end of the trial before (`Rules.carry`)."""

    def answers(self, view: View) -> None:
        """Take the view of the prompt whose reply is answered next."""

    def recorded(self, chosen: Selection) -> Mapping[str, Any]:
        """Return the facts about a selection that the record of its prompt needs."""
        return {}

    def pinned(self, turn: Turn) -> int | None:
        """Return the turn to pin after this one, with its observations masked, where it fits; None for none."""
        raise NotImplementedError

    def trimmed_before(self, step: int, before: int) -> int:
        """Return w: replies of turns older than this are trimmed at a step; `before` is w before the latest turn."""
        raise NotImplementedError

    def elided(self, shown: int, before: int) -> int:
        """Return p: of the `shown` pictures so far, the first p are elided; `before` is p before the latest turn."""
        raise NotImplementedError

    def shorten(self, text: str, first_cap: int, cap: int) -> str:
        """Return what is shown of an observation that is over `first_cap`, the cap on it; `cap` is that of results."""
        raise NotImplementedError

    def cut(self, reply_text: str) -> str:
        """Return the answer to `question` as it can be shown."""
        raise NotImplementedError

    def show(self, text: str) -> Summary:
        """Return the summary that shows words of `cut`."""
        raise NotImplementedError


DECISIONS: Mapping[str, str] = {
    "pinned": "pin a turn",
    "trimmed_before": "trim old replies",
    "elided": "elide pictures",
    "shorten": "decide what is shown of a result that is too long",
    "show": "ask for summaries",
}
"""The methods of `BudgetStrategy` that one strategy of a budget alone can override, in words."""


def decides(kind: type[BudgetStrategy], decision: str) -> bool:
    """Return whether a strategy makes a decision."""
    return getattr(kind, decision) is not getattr(BudgetStrategy, decision)


Boundary: TypeAlias = Callable[[int, int, int], int]
"""Returns a boundary at most a limit behind a step, given step, limit, and the boundary before the latest turn."""


def boundary(slack: float, words: Wording) -> Boundary:
    """Return how a boundary moves; with slack it does so in blocks."""
    if words.has_grid:
        return lambda step, limit, before: moved_on_grid(step, limit, slack)
    return lambda step, limit, before: moved_by_fold(step, limit, slack, before)
