"""The window of a custom strategy: it shows what the strategy chooses, within the cap and the history.

The strategy is asked once after every turn. A choice is sent only if it fits and each of its turns exists; any other
choice, and any exception of the strategy, ends the episode. Age is decided by the window alone: an observation older
than `history` is masked in every turn. The time for a prompt grows with what it shows, not with the conversation.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from itertools import islice

from smartplay_tools.context.base import Window
from smartplay_tools.context.strategies.choices import Choice, Past, PastTurn, PastTurns, Strategy
from smartplay_tools.context.turns import Form, Turn
from smartplay_tools.context.view import Selection, View
from smartplay_tools.context.window_state import Contents, WindowState
from smartplay_tools.errors import PromptOverflowError, StrategyError
from smartplay_tools.types.messages import Message


class ChoosingWindow(Window):
    """A window whose turns a custom strategy chooses."""

    _before: Contents | None = None
    _failure: Exception | None = None
    """The exception that the strategy raised; after it the strategy is not asked again."""
    _overflows = False

    def _begin(self, state: WindowState) -> None:
        self._now = Contents(state, state.selected(0))

    def append(self, turn: Turn) -> None:
        """Add a complete turn, and ask the strategy what is shown after it."""
        before, self._before = self._now, self._now
        state, cap = self._after(turn, before.state), self.budget.prompt_tokens
        self._now = Contents(state, chosen_selection(state, Choice(), {}))
        room = None if cap is None else cap - self._tokens(self._now)
        self._overflows = room is not None and room < 0
        if not self._overflows and self._failure is None:
            try:
                self._now = self._choose(state, room, before.selection.texts)
            except Exception as error:  # whatever the strategy does
                self._failure = error

    def view(self) -> View:
        """Return the next prompt; `PromptOverflowError` if the pinned parts do not fit.

        A choice that cannot be shown is a `StrategyError`, whose cause is the strategy's exception, if it raised one.
        """
        state, chosen, forms = self._now.state, self._now.selection, self._now.forms
        tokens = self._tokens(self._now)
        if self._overflows:
            raise PromptOverflowError(f"The pinned parts of the prompt take {tokens} tokens.")
        if self._failure is not None:
            raise StrategyError("The strategy has failed.") from self._failure
        before, prefix = self._before, 0
        if before is not None:
            prefix = self._prefix(before.state.head, before.forms, state.head, forms, tokens - state.head.tokens)
        return View(
            tools=self._tools,
            tokens=tokens,
            shown_steps=len({form.step for form in forms} - {None}),
            dropped_turns=state.turns - len(chosen),
            prefix_tokens=prefix,
            selection=chosen,
            forms=[*state.head.forms, *forms],
            turns=self._index.turns,
            text_tokens=sum(form.tokens(self._counter) for form in chosen.texts.values()),
        )

    def _choose(self, state: WindowState, room: int | None, texts: Mapping[int, Form]) -> Contents:
        assert isinstance(self._strategies.custom, Strategy)

        def text_tokens(text: str) -> int:
            return self._counter.message(text_message(text))

        choice = self._strategies.custom.choose(past_of(state, text_tokens), room)
        chosen = Contents(state, chosen_selection(state, choice, texts))
        cap = self.budget.prompt_tokens
        if room is not None and cap is not None and (over := self._tokens(chosen) - cap) > 0:
            raise StrategyError(f"The choice takes {room + over} tokens, and there is room for {room}.")
        return chosen

    def _tokens(self, contents: Contents) -> int:
        return contents.state.head.tokens + sum([form.tokens(self._counter) for form in contents.forms])


def text_message(text: str) -> Message:
    """Return the message that shows a text of a strategy."""
    return {"role": "user", "content": text}


def past_of(state: WindowState, text_tokens: Callable[[str], int]) -> Past:
    """Return what a strategy is shown after the turns of a state."""
    pinned = {index for index in (state.last, state.newest, state.notes) if index is not None}

    plain = state.selected(0)

    def make(number: int) -> PastTurn:
        turn, masked = state.index.turns[number], state.masked(number)
        tokens = state.run(number, number + 1)
        return PastTurn(number, turn.step, turn.shows, tokens, masked, number in pinned, turn, plain)

    turns = PastTurns(state.turns, make)
    return Past(turns, state.step, state.oldest, tuple(sorted(pinned)), text_tokens)


def chosen_selection(state: WindowState, choice: Choice, before: Mapping[int, Form]) -> Selection:
    """Return a choice with the pinned turns; `StrategyError` if it cannot be shown.

    `before` are the texts of the choice before: one that stays is the same message.
    """
    if not isinstance(choice, Choice):
        raise StrategyError(f"A strategy returns a Choice, not {type(choice).__name__}.")
    pinned = {index for index in (state.last, state.newest, state.notes) if index is not None}
    shown = pinned | _numbers(choice.turns, state.turns)
    masked = _numbers(choice.masked, state.turns)
    for index in sorted(masked):
        if index in pinned or index not in shown:
            why = "which is pinned" if index in pinned else "which it does not show"
            raise StrategyError(f"The choice masks turn {index}, {why}.")
    texts = _texts(choice.texts, shown, before)
    earlier = tuple(sorted(shown - {state.last}))
    facts = state.oldest, state.notes, state.words, 0, state.pictures
    return Selection(earlier, state.last, state.last, *facts, True, frozenset(masked), texts, first_whole=state.turns)


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


def _texts(given: Mapping[int, str], shown: set[int], before: Mapping[int, Form]) -> Mapping[int, Form]:
    if not isinstance(given, Mapping):
        raise StrategyError(f"The texts of a choice are a mapping from turns to texts, not {type(given).__name__}.")
    for index, text in given.items():
        if index not in shown or isinstance(index, bool):
            raise StrategyError(f"The choice has a text before turn {index!r}, which it does not show.")
        if not isinstance(text, str) or not text:
            raise StrategyError(f"The text before turn {index} is {text!r}, not a text.")
    stays = {index: form for index, form in before.items() if given.get(index) == form.message["content"]}
    return {index: stays.get(index) or Form(text_message(text)) for index, text in sorted(given.items())}
