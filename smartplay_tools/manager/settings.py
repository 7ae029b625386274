"""Settings: what a context manager was told of its prompts, checked."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.manager.counting import MessageCounter
from smartplay_tools.manager.forms import FORMS, Given
from smartplay_tools.types import ResolvedBudget

__all__ = ["FormName", "Settings", "check_choice", "check_numbers"]

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

    prompt_tokens: int | None
    messages: MessageCounter
    """Counts messages."""
    history: int | None = None
    slack: float = 0
    result_tokens: int | Literal["auto"] | None = None
    beyond_history: Literal["drop", "mask"] = "drop"
    own_words: int | None = None
    first_turns: int = 0
    newest_pictures: int | None = None
    head: Literal["task", "system"] = "task"
    pin: Callable[[Given], bool] | None = None
    cut: Literal["end", "middle"] = "end"
    repair: bool = True
    form: FormName | None = None

    def __post_init__(self) -> None:
        """Check them."""
        result_tokens = None if self.result_tokens == "auto" else self.result_tokens
        check_numbers(prompt_tokens=self.prompt_tokens, result_tokens=result_tokens)
        ages = {name: getattr(self, name) for name in ("history", "own_words", "first_turns", "newest_pictures")}
        check_numbers(0, **ages)
        check_choice("beyond_history", self.beyond_history, ("drop", "mask"))
        check_choice("head", self.head, ("task", "system"))
        check_choice("form", self.form, (None, *FORMS))
        if not 0 <= self.slack <= 1:
            raise InvalidArgumentError(f"slack is a share from 0 to 1, not {self.slack!r}.")
        if self.masks and self.history is None:
            raise InvalidArgumentError('beyond_history="mask" masks nothing without a history; give history a number.')

    @property
    def masks(self) -> bool:
        """Whether results older than the history are masked; otherwise their units are dropped."""
        return self.beyond_history == "mask"

    @cached_property
    def budget(self) -> ResolvedBudget:
        """What of them a window needs, all checked."""
        return ResolvedBudget.model_construct(
            history=self.history,
            slack=self.slack,
            beyond_history=self.beyond_history,
            own_words=self.own_words,
            first_turns=self.first_turns or None,
            newest_pictures=self.newest_pictures,
            prompt_tokens=self.prompt_tokens,
        )

    @property
    def recorded(self) -> dict[str, Any]:
        """What a record has of them."""
        return {"tokenizer": self.messages.counter.tokenizer.name, **{name: getattr(self, name) for name in RECORDED}}


def check_numbers(least: int = 1, **numbers: int | None) -> None:
    """Raise an `InvalidArgumentError` for a number that is none, or too small."""
    for name, number in numbers.items():
        if number is not None and (isinstance(number, bool) or not isinstance(number, int) or number < least):
            raise InvalidArgumentError(f"{name} is a whole number from {least} on, or None; it is {number!r}.")


def check_choice(name: str, value: object, choices: Iterable[object]) -> None:
    """Raise an `InvalidArgumentError` for a value that is none of the choices."""
    choices = list(choices)
    if value not in choices:
        raise InvalidArgumentError(f"{name} is one of {', '.join(map(repr, choices))}; it is {value!r}.")
