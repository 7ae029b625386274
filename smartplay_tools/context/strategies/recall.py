"""Recall: a tool that searches the observations that have left the agent's view.

An observation that a window drops or masks stays on record. The agent can ask for it by words or by steps. An answer
has the date of its call, and becomes too old when an observation of that step does. `docs/strategies.md` has the exact
definition.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from smartplay_tools.context.prompts.wording import Wording
from smartplay_tools.context.strategies.base import BudgetStrategy, StrategyTool, ToolAnswer
from smartplay_tools.context.tokens import TokenCounter, truncation
from smartplay_tools.context.view import View
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.types import RECALL_TOOL, Budget, ToolSpec
from smartplay_tools.types.arguments import text_parameters

STEPS = re.compile(r"\s*([0-9]{1,6})\s*(?:-\s*([0-9]{1,6})\s*)?")
"""A query for a step, or for the steps from one to another."""


class Recall(BudgetStrategy):
    """Adds `recall`, which finds observations that the prompt does not show."""

    name = "recall_tokens"
    option_help = "Cap on an answer of the tool that searches observations that have left; none: no such tool."

    def __init__(self, budget: Budget, counter: TokenCounter, words: Wording) -> None:
        from smartplay_tools.context.strategies.documents import Documents

        assert budget.recall_tokens is not None
        self._cap, self._count, self._words = budget.recall_tokens, counter.text, words
        self._documents = Documents(*words.around("recalled", "step"))
        self._view: View | None = None
        """The view of the prompt whose reply is being answered; None before the first, and without a conversation."""
        spec = recall_spec(self._cap, words)
        self.tools = (StrategyTool(spec, "query", words("recall_usage"), self._answer),)

    @classmethod
    def refusal(cls, budget: Budget, history: int | None) -> str | None:
        """Return why there is nothing to find: no observation ever leaves."""
        if budget.prompt_tokens is None and history is None:
            return "recall_tokens has nothing to find where no observation ever leaves; give prompt_tokens a number."
        return None

    @classmethod
    def refused_form(cls, observation: str) -> str | None:
        """Return why it finds nothing where observations have no words."""
        if observation == "picture":
            return (
                'recall_tokens searches words, and with observation="picture" there are none; use observation="both".'
            )
        return None

    def check(self, budget: Budget, least: int) -> None:
        """Raise an `InvalidArgumentError` if a prompt cannot hold an answer beside a result.

        `least` counts what every prompt holds, and what is kept free.
        """
        cap, results = budget.prompt_tokens, budget.result_tokens
        needed = least + self._cap + (results if isinstance(results, int) else 0)
        if cap is not None and cap < needed:
            raise InvalidArgumentError(
                f"recall_tokens={self._cap} needs prompt_tokens of at least {needed}, for an answer beside a result; "
                "lower it, or raise prompt_tokens well above that."
            )

    def answers(self, view: View) -> None:
        """Take the view of the prompt whose reply is answered next."""
        self._view = view
        self._documents.read(view.turns)

    def _answer(self, query: str) -> ToolAnswer:
        """Answer with the first documents that fit the cap."""
        view = self._view
        if view is None:
            return ToolAnswer(self._words("nothing_to_recall"), mistake="refused")
        shown = self._documents.shown_by(view)
        if (steps := STEPS.fullmatch(query)) is not None:
            first, last = int(steps[1]), int(steps[2] or steps[1])
            matching = self._documents.between(first, last, shown)
        else:
            matching = self._documents.best(query, shown)
        return self._fitted(matching)

    def _fitted(self, documents: Iterator[int]) -> ToolAnswer:
        """The longest beginning of a list of documents that fits the cap; at least the beginning of the first."""
        numbers, texts = list[int](), list[str]()

        def fits(count: int) -> bool:
            while len(texts) < count and (number := next(documents, None)) is not None:
                numbers.append(number)
                texts.append(self._documents[number])
            return len(texts) >= count and self._count("\n\n".join(texts[:count])) <= self._cap

        low, high = 0, 1
        while fits(high):
            low, high = high, 2 * high
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if fits(middle) else (low, middle)
        if low:
            return self._recalled("\n\n".join(texts[:low]), numbers[:low], is_cut=False)
        text = texts[0] if texts else self._words("recalled_nothing")
        if self._count(text) <= self._cap:
            return self._recalled(text, numbers, is_cut=False)
        return self._recalled(
            truncation.cut_end(text, self._cap, self._count, self._words.cut), numbers[:1], is_cut=True
        )

    def _recalled(self, text: str, numbers: list[int], *, is_cut: bool) -> ToolAnswer:
        return ToolAnswer(text, {"recalled": [self._documents.steps[number] for number in numbers]}, is_cut=is_cut)


def recall_spec(cap: int, words: Wording) -> ToolSpec:
    """Return the tool with which an agent searches; an answer has at most `cap` tokens."""
    return ToolSpec(RECALL_TOOL, words("recall", cap=cap), text_parameters(query=words("recall_query")))
