"""Asking: who is asked what a prompt needs of a model, and how its answers become a part of the prompt."""

from __future__ import annotations

import asyncio
import inspect
import math
from collections.abc import Awaitable, Callable, Generator, MutableMapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Literal

from smartplay_tools.context.compaction import Compactor
from smartplay_tools.context.strategies.choices import Strategy
from smartplay_tools.errors import InvalidArgumentError, check_choice
from smartplay_tools.manager.fitted import Draft, FittedPrompt
from smartplay_tools.manager.memo import MemoFolder, Texts
from smartplay_tools.manager.settings import Settings, check_numbers
from smartplay_tools.manager.strategy import StrategyMaker, StrategyRunner
from smartplay_tools.manager.summaries import AskError, Question, Summaries, SummaryChain

Ask = Callable[[list[dict[str, Any]], int], str | Awaitable[str]]
"""Asks a model: returns its answer to chat messages of words alone, in at most so many tokens."""

GivenStrategy = Summaries | Strategy | Compactor | type | Callable[..., Any] | str
"""What a user may give as a strategy."""

Memo = MutableMapping[str, str] | str | Path
"""Where answers are kept: a mapping, or a folder."""

Fitting = Generator[Question, str, FittedPrompt]
"""Makes a prompt: yields the questions that it needs, is sent the answers, and returns it."""


class Asking:
    """The strategy of a manager, if it has one, and the function that asks a model for it."""

    def __init__(
        self,
        settings: Settings,
        strategy: GivenStrategy | None = None,
        ask: Ask | None = None,
        *,
        question_tokens: int | None = None,
        memo: Memo | None = None,
        on_error: Literal["raise", "drop"] = "raise",
    ) -> None:
        check_choice("on_error", on_error, ("raise", "drop"))
        self._settings, self._ask, self._on_error = settings, ask, on_error
        self.summaries: SummaryChain | None = None
        self.strategy: StrategyRunner | None = None
        self.recorded: dict[str, Any] = {}
        """What a record has of the strategy."""
        if isinstance(strategy, Summaries):
            self.summaries = self._chain(strategy, memo)
        elif strategy is not None:
            self.strategy = self._runner(StrategyMaker(strategy), question_tokens, memo)
        elif ask is not None or memo is not None:
            raise InvalidArgumentError("Nobody asks without a strategy; give strategy=Summaries(tokens=...).")
        if question_tokens is not None and (self.strategy is None or not self.strategy.compacts):
            raise InvalidArgumentError(
                "question_tokens is the cap on questions of a compactor; give one, or leave it out."
            )

    def _runner(self, make: StrategyMaker, question_tokens: int | None, memo: Memo | None) -> StrategyRunner:
        """The runner of a strategy; an option that it decides itself is an `InvalidArgumentError`."""
        settings, budget = self._settings, self._settings.budget
        own_words = budget.own_words if make.compacts else None
        decided: dict[str, object] = {"beyond_history": settings.masks or None, "first_turns": budget.first_turns}
        decided |= {"newest_pictures": budget.newest_pictures, "own_words": own_words}
        for name, given in decided.items():
            if given is not None:
                what = "rewrites messages" if make.compacts else "chooses the turns"
                raise InvalidArgumentError(
                    f"The strategy {make.name} {what} itself, so {name} has no meaning; leave it out."
                )
        check_numbers(question_tokens=question_tokens)
        self.recorded = {"strategy": make.name, "question_tokens": question_tokens}
        budget = budget.model_copy(update={"question_tokens": question_tokens or budget.prompt_tokens})
        goes_on = self._on_error == "drop"
        return StrategyRunner(make, budget, settings.messages, kept_in(memo), goes_on=goes_on)

    def _chain(self, strategy: Summaries, memo: Memo | None) -> SummaryChain:
        """The maker of summaries; what would never be asked, or at every step, is an `InvalidArgumentError`."""
        check_numbers(**asdict(strategy))
        settings, budget, cap = self._settings, self._settings.budget, self._settings.budget.prompt_tokens
        drops = budget.history is not None and not settings.masks
        if not callable(self._ask):
            raise InvalidArgumentError("Summaries are asked for; give ask, a function of messages and max_tokens.")
        if cap is None and not drops:
            raise InvalidArgumentError("Nothing ever leaves, so there is nothing to summarise; give prompt_tokens.")
        if budget.slack == 0 or (drops and math.floor(budget.slack * (budget.history or 0)) < 1):
            raise InvalidArgumentError("A summary would be asked for at every step; raise slack, or history.")
        self.recorded = {f"summary_{name}": number for name, number in asdict(strategy).items()}
        return SummaryChain(strategy, cap, settings.messages.counter, kept_in(memo))

    def answered(self, fitting: Fitting) -> FittedPrompt:
        """Ask what a prompt needs, and return it."""
        made = _next(fitting, None)
        while not isinstance(made, FittedPrompt):
            ask = self._asked()
            try:
                answer = ask(*made)
            except Exception as error:  # whatever a model's client raises
                answer = error
            made = _next(fitting, answer)
        return made

    async def aanswered(self, fitting: Fitting) -> FittedPrompt:
        """Do what `answered` does. An asynchronous function is awaited; any other runs in a thread."""
        made = _next(fitting, None)
        while not isinstance(made, FittedPrompt):
            ask = self._asked()
            try:
                is_async = inspect.iscoroutinefunction(ask)
                answer = ask(*made) if is_async else await asyncio.to_thread(ask, made[0], made[1])
                if inspect.isawaitable(answer):
                    answer = await answer
            except Exception as error:  # whatever a model's client raises
                answer = error
            made = _next(fitting, answer)
        return made

    def completed(self, draft: Draft) -> Generator[Question, str, Draft]:
        """Yield the questions that a prompt needs; return it with what was answered."""
        try:
            if self.summaries is not None and draft.covered is not None:
                text = yield from self.summaries.text(draft.covered)
                shown = self.summaries.shown(text, draft.covered.form) if text else None
                return replace(draft, summary=shown)
            if self.strategy is not None and draft.asked is not None:
                return replace(draft, chosen=(yield from self.strategy.chosen(draft.asked)))
        except AskError as error:
            if self._on_error == "raise" or self.summaries is None:
                raise error.reason from None
            return replace(draft, failed=str(error))
        return draft

    def _asked(self) -> Callable[..., Any]:
        """The function that asks a model."""
        if not callable(self._ask):
            raise InvalidArgumentError("The strategy asks a model; give ask, a function of messages and max_tokens.")
        return self._ask


def _next(fitting: Fitting, answer: str | Exception | None) -> Question | FittedPrompt:
    """Go on with an answer, or with what was raised in its place; return the next question, or the prompt."""
    try:
        if isinstance(answer, Exception):
            return fitting.throw(AskError(answer))
        return next(fitting) if answer is None else fitting.send(answer)
    except StopIteration as end:
        prompt: FittedPrompt = end.value
        return prompt


def kept_in(memo: Memo | None) -> Texts:
    """Return where answers are kept."""
    if memo is not None and not isinstance(memo, str | Path | MutableMapping):
        raise InvalidArgumentError(f"A memo is a folder or a mutable mapping, not {type(memo).__name__}.")
    return MemoFolder(memo) if isinstance(memo, str | Path) else {} if memo is None else memo
