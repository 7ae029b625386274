"""Settings: what a context manager was told of its prompts, checked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

from smartplay_tools.errors import InvalidArgumentError, check_choice
from smartplay_tools.manager.counting import MessageCounter
from smartplay_tools.manager.forms import Given, form_of
from smartplay_tools.types import ResolvedBudget

FormName = Literal["chat", "responses", "anthropic"]
"""The name of a form of messages."""

RECORDED = (
    *("head", "cut", "history", "slack", "masks", "own_words", "first_turns", "newest_pictures"),
    *("prompt_tokens", "result_tokens", "repair"),
)
"""What a record has of the settings, in this order, after the tokenizer."""


@dataclass(frozen=True)
class Settings:
    """The arguments of a `ContextManager` that shape a prompt; one that has no meaning is an `InvalidArgumentError`."""

    budget: ResolvedBudget
    """What of them a window needs; it is checked here."""
    messages: MessageCounter
    """Counts messages."""
    result_tokens: int | Literal["auto"] | None
    head: Literal["task", "system"]
    pin: Callable[[Given], bool] | None
    cut: Literal["end", "middle"]
    repair: bool
    form: FormName | None

    def __post_init__(self) -> None:
        """Check them."""
        budget, result_tokens = self.budget, None if self.result_tokens == "auto" else self.result_tokens
        check_numbers(prompt_tokens=budget.prompt_tokens, result_tokens=result_tokens)
        ages = {name: getattr(budget, name) for name in ("history", "own_words", "first_turns", "newest_pictures")}
        check_numbers(0, **ages)
        check_choice("beyond_history", budget.beyond_history, ("drop", "mask"))
        check_choice("head", self.head, ("task", "system"))
        form_of((), self.form)
        if not 0 <= budget.slack <= 1:
            raise InvalidArgumentError(f"slack is a share from 0 to 1, not {budget.slack!r}.")
        if self.masks and budget.history is None:
            raise InvalidArgumentError('beyond_history="mask" masks nothing without a history; give history a number.')

    @property
    def masks(self) -> bool:
        """Whether results older than the history are masked; otherwise their units are dropped."""
        return self.budget.beyond_history == "mask"

    @property
    def recorded(self) -> dict[str, Any]:
        """What a record has of them."""
        own = {name: getattr(self, name, getattr(self.budget, name, None)) for name in RECORDED}
        first_turns = self.budget.first_turns or 0
        return {"tokenizer": self.messages.counter.tokenizer.name, **own, "first_turns": first_turns}


def check_numbers(least: int = 1, **numbers: int | None) -> None:
    """Raise an `InvalidArgumentError` for a number that is none, or too small."""
    for name, number in numbers.items():
        if number is not None and (isinstance(number, bool) or not isinstance(number, int) or number < least):
            raise InvalidArgumentError(f"{name} is a whole number from {least} on, or None; it is {number!r}.")
