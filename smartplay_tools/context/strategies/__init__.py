"""Strategies for the past: what happens to turns that a prompt can no longer hold, a class for each way.

A field of `Budget` asks for a strategy. Its class stands in a file of this folder and says what it refuses, which tools
it adds, how many tokens it reserves, and what it pins, hides or asks for. `Strategies` holds those of one episode, and
the window and the episode ask it.

To add a strategy:

1. Add its field to `Budget` in `types/budget.py`, annotated with `Keeps`, which says how it reads in tables.
2. Write its class in a file here: a `BudgetStrategy` with the field's name and the help of its command-line option.
3. List its place in `KINDS`, in the order of the fields.

Commands, sweeps, records, tables and the list of deviations take it from there.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Any

from smartplay_tools.context.prompts.wording import Wording
from smartplay_tools.context.strategies import custom
from smartplay_tools.context.strategies.ageing import Ageing
from smartplay_tools.context.strategies.base import DECISIONS, BudgetStrategy, decides
from smartplay_tools.context.tokens import TokenCounter
from smartplay_tools.context.view import Selection, View
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.registry import Registry
from smartplay_tools.types import STRATEGIES, Budget

if TYPE_CHECKING:
    from smartplay_tools.context.compaction import Compactor
    from smartplay_tools.context.strategies.choices import Strategy

__all__ = ["KINDS", "Strategies", "refusal"]


KINDS = Registry(
    "strategy of a budget",
    {
        "beyond_history": f"{__name__}.ageing:Ageing",
        "notes_tokens": f"{__name__}.notes:Notes",
        "summary_tokens": f"{__name__}.summaries:Summaries",
        "own_words": f"{__name__}.thoughts:Thoughts",
        "first_turns": f"{__name__}.anchors:Anchors",
        "recall_tokens": f"{__name__}.recall:Recall",
        "beyond_result": f"{__name__}.offload:Offload",
        "memory_tokens": f"{__name__}.memory:MemoryFiles",
        "newest_pictures": f"{__name__}.pictures:Pictures",
        "strategy": f"{__name__}.custom:Custom",
    },
)
"""Every strategy by the field of `Budget` that asks for it, in the order in which they are asked.

A class is imported when a budget asks for it: most episodes need none of them.
"""

if list(KINDS) != list(STRATEGIES):
    raise TypeError(f"The fields of Budget ask for {', '.join(STRATEGIES)}, and KINDS has {', '.join(KINDS)}.")


class Strategies:
    """The strategies of one episode: objects for those that its budget asks for."""

    def __init__(self, budget: Budget, counter: TokenCounter, words: Wording) -> None:
        self.asked = {name: KINDS[name](budget, counter, words) for name in budget.strategies}
        """The strategies by the fields that ask for them."""
        asked = tuple(self.asked.values())
        deciding = {name: next((s for s in asked if decides(type(s), name)), None) for name in DECISIONS}
        self.ageing: Ageing = self.asked.get(Ageing.name) or Ageing(budget, counter, words)
        """Decides what happens to turns that are too old."""
        self.pinning = deciding["pinned"]
        """The strategy that pins a turn; None without one."""
        self.trimming, self.eliding = deciding["trimmed_before"], deciding["elided"]
        """The strategies that trim old replies, and elide older pictures; None without one."""
        self.shortening, self.summaries = deciding["shorten"], deciding["show"]
        """The strategies that show a part of a long result, and ask for summaries of what leaves; None without one."""
        self.first_turns = max((strategy.first_turns for strategy in asked), default=0)
        """How many of the first turns stay, as far as they fit."""
        self.tools = tuple(tool for strategy in asked for tool in strategy.tools)
        """The tools that they add."""
        self.reserve = sum(strategy.reserve for strategy in asked)
        """R: the tokens that a window leaves free when it moves."""
        self.reserved_for = ", ".join(f"{s.name}={getattr(budget, s.name)}" for s in asked if s.reserve)
        """The fields of the budget that need the reserve."""
        self.custom: Strategy | Compactor | None = None
        """The custom strategy that chooses turns or rewrites them, once it is loaded; None where the window chooses."""
        self.recorded_rewritings: deque[tuple[bool, list[Any] | None]] = deque()
        """What a compactor did next in a record that is played again, as far as it is not played yet.

        Each is whether it asked a question, and the messages (`RewriteEvent.messages`).
        """
        self.calls_compactor = True
        """Whether a compactor is called, and does not only stand for what a record says it did."""
        self._budget, self.words = budget, words

    def load_custom(self, digest: str | None, *, is_recorded: bool) -> None:
        """Make the custom strategy that the budget names, if it names one; `digest` is that of its file.

        With `is_recorded` nothing is imported that the user has not named.
        """
        if (name := self._budget.strategy) is not None:
            loaded = (custom.recorded_strategy if is_recorded else custom.load_strategy)(name, digest)
            self.custom = custom.make_strategy(name, loaded)
            if reason := custom.refused_with(self.custom, self._budget):
                raise InvalidArgumentError(reason)

    @property
    def compacts(self) -> bool:
        """Whether a compactor rewrites the history."""
        return custom.compacts(self.custom)

    @property
    def asking(self) -> str | None:
        """The field of the budget that asks the agent for words; None if none does."""
        if self.summaries is not None:
            name: str = self.summaries.name
            return name
        return "strategy" if self.compacts else None

    def check(self, budget: Budget, least: int) -> None:
        """Raise an `InvalidArgumentError` if a prompt cannot hold what a strategy shows; `least` is without it."""
        for strategy in self.asked.values():
            strategy.check(budget, least)

    def answers(self, view: View) -> None:
        """Take the view of the prompt whose reply is answered next."""
        for strategy in self.asked.values():
            strategy.answers(view)

    def recorded(self, chosen: Selection) -> dict[str, Any]:
        """Return the facts about a selection that the record of its prompt needs."""
        pinned: dict[str, Any] = {"notes": None}
        if self.pinning is not None:
            pinned[self.pinning.records_pin_as] = chosen.pinned
        return pinned | {
            name: fact for strategy in self.asked.values() for name, fact in strategy.recorded(chosen).items()
        }


def refusal(budget: Budget, history: int | None, observation: str) -> str | None:
    """Return why what a budget asks for cannot be enforced, in one sentence.

    `history` is the budget's in numbers, and `observation` what observations are.
    """
    asked: list[type[BudgetStrategy]] = [KINDS[name] for name in budget.strategies]
    for kind in asked:
        if reason := kind.refusal(budget, history) or kind.refused_form(observation):
            return reason
    for decision, words in DECISIONS.items():
        if len(names := [kind.name for kind in asked if decides(kind, decision)]) > 1:
            return f"{' and '.join(names)} both {words}, and one strategy alone can; leave one of them out."
    return None
