"""The window of a custom strategy: it shows what the strategy chooses, within the cap and the history.

The strategy is asked once after every turn. A choice is sent only if it fits and each of its turns exists; any other
choice, and any exception of the strategy, ends the episode. Age is decided by the window alone: an observation older
than `history` is masked in every turn. The time for a prompt grows with what it shows, not with the conversation.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from itertools import islice, zip_longest

from smartplay_tools.context.prefix import common_head, common_messages
from smartplay_tools.context.strategies.choices import Choice, Past, PastTurn, PastTurns, Strategy
from smartplay_tools.context.turns import Turn
from smartplay_tools.context.view import Selection, View
from smartplay_tools.context.window import ContextWindow
from smartplay_tools.context.window_state import Contents, WindowState
from smartplay_tools.errors import PromptOverflowError, StrategyError
from smartplay_tools.transcript.hashing import head_bytes
from smartplay_tools.types.messages import Message


class ChoosingWindow(ContextWindow):
    """A window whose turns a custom strategy chooses."""

    _failure: Exception | None = None
    """The exception that the strategy raised; after it the strategy is not asked again."""

    def append(self, turn: Turn) -> None:
        """Add a complete turn, and ask the strategy what is shown after it."""
        state, cap = self._after(turn), self.budget.prompt_tokens
        selection = chosen_selection(state, Choice())
        room = None if cap is None else cap - self._tokens(state, selection)
        self._overflows = room is not None and room < 0
        if not self._overflows and self._failure is None:
            try:
                selection = self._choose(state, room)
            except Exception as error:  # whatever the strategy does
                self._failure = error
        self._now = Contents(state, selection, None)

    def view(self) -> View:
        """Return the contents of the next prompt; `PromptOverflowError` if the pinned parts do not fit.

        A choice that cannot be shown is a `StrategyError`, whose cause is the strategy's exception, if it raised one.
        """
        state, chosen = self._now.state, self._now.selection
        tokens = self._tokens(state, chosen)
        if self._overflows:
            raise PromptOverflowError(f"The pinned parts of the prompt take {tokens} tokens.")
        if self._failure is not None:
            raise StrategyError("The strategy has failed.") from self._failure
        before, prefix = self._before, 0
        if before is not None:
            prefix = self._prefix(before, self._now)
        return self._view_of(self._now, tokens, prefix)

    def canonical(self, view: View) -> list[bytes]:
        """Return the canonical JSON of the latest view's messages, of which the prompt's sha256 is made."""
        state, chosen = self._now.state, self._now.selection
        lines = state.head.canonical.copy()
        for index in chosen:
            if index in chosen.texts:
                lines.append(head_bytes(text_message(chosen.texts[index])))
            lines += chosen.canonical_seen(state.index.turns[index])
        return lines

    def _choose(self, state: WindowState, room: int | None) -> Selection:
        assert isinstance(self._strategies.custom, Strategy)
        choice = self._strategies.custom.choose(past_of(state, self._text_tokens), room)
        selection = chosen_selection(state, choice)
        cap = self.budget.prompt_tokens
        if room is not None and cap is not None and (over := self._tokens(state, selection) - cap) > 0:
            raise StrategyError(f"The choice takes {room + over} tokens, and there is room for {room}.")
        return selection

    def _view_of(self, contents: Contents, tokens: int, prefix: int) -> View:
        state, chosen = contents.state, contents.selection
        turns, shown = state.index.turns, list(state.head.messages)
        steps: set[int] = set()
        for index in chosen:
            if index in chosen.texts:
                shown.append(text_message(chosen.texts[index]))
            turn = turns[index]
            shown += chosen.seen(turn)
            masked = chosen.masked_items(turn)
            shows = [
                step
                for at, item in enumerate(turn.items)
                if (step := item.observation_step) is not None and at not in masked
            ]
            steps.update(shows)
        return View(
            tools=self._tools,
            tokens=tokens,
            shown_steps=len(steps),
            dropped_turns=state.turns - len(chosen),
            prefix_tokens=prefix,
            selection=chosen,
            shown=tuple(shown),
            turns=turns,
            text_tokens=self._written_tokens(chosen),
        )

    # The tokens of a selection.

    def _text_tokens(self, text: str) -> int:
        return self._counter.message(text_message(text))

    def _tokens(self, state: WindowState, chosen: Selection) -> int:
        turns = sum(_turn_tokens(state, chosen, index) for index in chosen)
        return state.head.tokens + turns + self._written_tokens(chosen)

    def _written_tokens(self, chosen: Selection) -> int:
        return sum(map(self._text_tokens, chosen.texts.values()))

    def _prefix(self, before: Contents, now: Contents) -> int:
        """The tokens at the beginning that are the same as in the view before the latest turn."""
        state, chosen, chosen_before = now.state, now.selection, before.selection
        shared, is_same = common_head(before.state.head, state.head, self._tools_tokens, self._counter)
        if not is_same:
            return shared
        for index, was in zip_longest(chosen, chosen_before):
            if index != was or chosen.texts.get(index) != chosen_before.texts.get(was):
                return shared
            if index in chosen.texts:
                shared += self._text_tokens(chosen.texts[index])
            turn = state.index.turns[index]
            tokens, is_whole = common_messages(turn, chosen_before, chosen, self._counter)
            shared += tokens
            if not is_whole:
                return shared
        return shared


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


def chosen_selection(state: WindowState, choice: Choice) -> Selection:
    """Return a choice with the pinned turns; `StrategyError` if it cannot be shown."""
    if not isinstance(choice, Choice):
        raise StrategyError(f"A strategy returns a Choice, not {type(choice).__name__}.")
    pinned = {index for index in (state.last, state.newest, state.notes) if index is not None}
    shown = pinned | _numbers(choice.turns, state.turns)
    masked = _numbers(choice.masked, state.turns)
    for index in sorted(masked):
        if index in pinned or index not in shown:
            why = "which is pinned" if index in pinned else "which it does not show"
            raise StrategyError(f"The choice masks turn {index}, {why}.")
    texts = _texts(choice.texts, shown)
    earlier = tuple(sorted(shown - {state.last}))
    facts = state.oldest, state.notes, state.words, 0, state.pictures
    return Selection(earlier, state.last, state.last, *facts, True, frozenset(masked), texts)


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


def _texts(given: Mapping[int, str], shown: set[int]) -> Mapping[int, str]:
    if not isinstance(given, Mapping):
        raise StrategyError(f"The texts of a choice are a mapping from turns to texts, not {type(given).__name__}.")
    for index, text in given.items():
        if index not in shown or isinstance(index, bool):
            raise StrategyError(f"The choice has a text before turn {index!r}, which it does not show.")
        if not isinstance(text, str) or not text:
            raise StrategyError(f"The text before turn {index} is {text!r}, not a text.")
    return dict(sorted(given.items()))


def _turn_tokens(state: WindowState, chosen: Selection, index: int) -> int:
    if index == chosen.hidden or index in chosen.masked:
        return state.masked(index)
    return state.run(index, index + 1)
