"""The rule of a custom strategy: a prompt shows what it chooses, within the cap and the history.

The strategy is asked once for each prompt. A choice is sent only if it fits and each of its turns exists; any other
choice, and any exception of the strategy, ends the episode. Age is decided by the window alone: an observation older
than `history` is masked in every turn. The time for a prompt grows with what it shows, not with the conversation.
"""

from __future__ import annotations

from collections.abc import Collection, Generator, Iterable, Mapping
from itertools import islice

from smartplay_tools.context.strategies.choices import Choice, Past, PastTurn, PastTurns, Strategy
from smartplay_tools.context.turns import Form
from smartplay_tools.context.view import Selection, View, ranges_of
from smartplay_tools.context.window import ContextWindow, Rule
from smartplay_tools.errors import PromptOverflowError, StrategyError
from smartplay_tools.types.messages import Message


def choosing(window: ContextWindow, strategy: Strategy) -> Rule:
    """Return the rule by which a strategy chooses the turns of a window."""
    texts: Mapping[int, Form] = {}

    def make() -> Generator[View, Message | None, Selection]:
        nonlocal texts
        if not window.turns:
            return Selection([range(0)])
        cap, always = window.budget.prompt_tokens, window.always_tokens
        if cap is not None and always > cap:
            raise PromptOverflowError(f"The pinned parts of the prompt take {always} tokens.")
        try:
            choice = strategy.choose(_past(window), None if cap is None else cap - always)
            choice = checked(choice, window.always, len(window.turns))
        except Exception as error:  # whatever the strategy does
            raise StrategyError("The strategy has failed.") from error
        texts = {turn: _form(text, texts.get(turn)) for turn, text in choice.texts.items()}
        return _selection(window, choice, texts)
        yield  # a rule that asks no questions

    return make


def _form(text: str, before: Form | None) -> Form:
    """Return the message of a text; one that stays is the same message."""
    return before if before is not None and before.message["content"] == text else Form(text_message(text))


def _selection(window: ContextWindow, choice: Choice, texts: Mapping[int, Form]) -> Selection:
    rows = [range(first, last + 1) for first, last in ranges_of(choice.turns)]
    spoken = [[turn, text] for turn, text in choice.texts.items()]
    ages = window.oldest, window.trimmed_before, window.elided
    masked = frozenset(choice.masked)
    return Selection(rows, window.pieces(rows, texts), *ages, masked, window.pinned, {"texts": spoken})


def _past(window: ContextWindow) -> Past:
    """What a strategy is shown."""
    always = window.always

    def make(number: int) -> PastTurn:
        row = window.row(number, number + 1)
        tokens, masked = window.tokens(row), window.masked_tokens(number)
        return PastTurn(
            number, window.turns[number], tokens, masked, number in always, window.now[row.start : row.stop]
        )

    def text_tokens(text: str) -> int:
        return window.counter.message(text_message(text))

    turns = PastTurns(len(window.turns), make)
    return Past(turns, window.turns[-1].step, window.oldest, tuple(sorted(always)), text_tokens)


def text_message(text: str) -> Message:
    """Return the message that shows a text of a strategy."""
    return {"role": "user", "content": text}


def checked(choice: Choice, pinned: Collection[int], turns: int) -> Choice:
    """Return a choice with the pinned turns, in ascending order; `StrategyError` if it cannot be shown."""
    if not isinstance(choice, Choice):
        raise StrategyError(f"A strategy returns a Choice, not {type(choice).__name__}.")
    shown = _numbers(choice.turns, turns).union(pinned)
    masked = _numbers(choice.masked, turns)
    for index in sorted(masked):
        if index in pinned or index not in shown:
            why = "which is pinned" if index in pinned else "which it does not show"
            raise StrategyError(f"The choice masks turn {index}, {why}.")
    return Choice(sorted(shown), sorted(masked), _texts(choice.texts, shown))


def _numbers(given: Iterable[int], turns: int) -> set[int]:
    numbers: set[int] = set()
    for number in islice(given, turns + 1):  # an endless one names a turn twice, or one that does not exist
        if not isinstance(number, int) or isinstance(number, bool):
            raise StrategyError(f"A choice names turns by their numbers, not by {number!r}.")
        if not 0 <= number < turns:
            raise StrategyError(f"The choice names turn {number}, and there are turns 0 to {turns - 1}.")
        if number in numbers:
            raise StrategyError(f"The choice names turn {number} twice.")
        numbers.add(number)
    return numbers


def _texts(given: Mapping[int, str], shown: Collection[int]) -> Mapping[int, str]:
    if not isinstance(given, Mapping):
        raise StrategyError(f"The texts of a choice are a mapping from turns to texts, not {type(given).__name__}.")
    for index, text in given.items():
        if index not in shown or isinstance(index, bool):
            raise StrategyError(f"The choice has a text before turn {index!r}, which it does not show.")
        if not isinstance(text, str) or not text:
            raise StrategyError(f"The text before turn {index} is {text!r}, not a text.")
    return dict(sorted(given.items()))
