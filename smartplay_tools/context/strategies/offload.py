"""Offload: the beginning of a result that is too long is shown, and a tool reads on.

A cut loses the rest of a result. Here the rest stays with the episode, in pages that fit the same cap, and the last
line of every page names the next page. Pages are made of the game's own text, so a replay makes them again.
"""

from __future__ import annotations

import re

from smartplay_tools.context.prompts.wording import Wording
from smartplay_tools.context.strategies.base import BudgetStrategy, StrategyTool, ToolAnswer
from smartplay_tools.context.tokens import TokenCounter, truncation
from smartplay_tools.types import PAGES_TOOL, Budget, ToolSpec
from smartplay_tools.types.arguments import text_parameters

PAGE = re.compile(r"r([1-9][0-9]{0,5})\.([1-9][0-9]{0,5})")


class Pages:
    """The pages of one result, each made when it is asked for."""

    def __init__(
        self, number: int, text: str, first_cap: int, cap: int, count: truncation.Count, words: Wording
    ) -> None:
        """`first_cap` is the cap on what the result shows, `cap` the cap on each later page."""
        self._number, self._rest, self._count, self._words = number, text, count, words
        self._next_cap, self._cap = first_cap, cap
        self._pages: list[str] = []
        self._is_whole = False

    def page(self, number: int) -> str | None:
        """Return a page, the first of which is 1; None if there is no such page."""
        while len(self._pages) < number and not self._is_whole:
            self._pages.append(self._cut())
        return self._pages[number - 1] if number <= len(self._pages) else None

    def _cut(self) -> str:
        """Take the next page off the rest."""
        cap, self._next_cap = self._next_cap, self._cap
        if self._count(self._rest) <= cap:
            self._is_whole = True
            return self._rest
        following = f"r{self._number}.{len(self._pages) + 2}"

        def line(missing: int) -> str:
            return self._words("next_page", missing=missing, page=following)

        page, length = truncation.cut_page(self._rest, cap, self._count, line)
        self._rest, self._is_whole = self._rest[length:], not length
        return page


class Offload(BudgetStrategy):
    """Shows the beginning of a result that is too long, and adds `read_result`, which reads on."""

    name = "beyond_result"
    option_help = "Observations over --result-tokens: cut, or offload (a tool reads on)."

    def __init__(self, budget: Budget, counter: TokenCounter, words: Wording) -> None:
        self._count, self._words = counter.text, words
        self._results: list[Pages] = []
        self.tools = (StrategyTool(pages_spec(words), "page", words("read_result_usage"), self._read),)

    @classmethod
    def refusal(cls, budget: Budget, history: int | None) -> str | None:
        """Return why there is nothing to offload: no result is ever cut."""
        results = budget.result_tokens
        if results is None or (results == "auto" and budget.prompt_tokens is None):
            return (
                'beyond_result="offload" has nothing to offload where no result is ever cut; give result_tokens a '
                'number, or leave it at "cut".'
            )
        return None

    def shorten(self, text: str, first_cap: int, cap: int) -> str:
        """Keep a text that is over its cap; return its first page."""
        self._results.append(Pages(len(self._results) + 1, text, first_cap, cap, self._count, self._words))
        page = self._results[-1].page(1)
        assert page is not None
        return page

    def _read(self, page: str) -> ToolAnswer:
        if (match := PAGE.fullmatch(page)) and int(match[1]) <= len(self._results):
            text = self._results[int(match[1]) - 1].page(int(match[2]))
            if text is not None:
                return ToolAnswer(text, {"page": page}, is_cut=False)
        reason = self._words("no_such_page", usage=self._words("read_result_usage"))
        return ToolAnswer(reason, mistake="malformed")


def pages_spec(words: Wording) -> ToolSpec:
    """Return the tool with which an agent reads on."""
    return ToolSpec(PAGES_TOOL, words("read_result"), text_parameters(page=words("read_result_page")))
