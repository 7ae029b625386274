"""The context window: selects what the model may see, again after every appended turn.

A view has four parts: the head (system, task, the manual once it has been read); the summary, if there is one; the
pinned turns (the newest turn, the latest turn that shows the newest observation, the turn with the notes); and earlier
turns. Earlier turns are added from the newest back, as long as they fit and are not too old. Two rules are absolute: no
view is longer than `prompt_tokens`, and no observation in it is older than `history` steps. `docs/budgets.md` and
`docs/strategies.md` have the exact definition.

Deciding a view takes a few bisections (`context.token_index`), at turn 10,000 as at turn 10. The tokens of a view fall
as its first turn moves on, except where the run begins to include the notes: their turn is masked whole before the run
and by age inside it, and a marker can be longer than what it replaces. So the first turn is searched for in two halves,
before and after that turn.

What is too old, what is pinned and what is kept free is decided by the strategies (`context.strategies`). Where one of
them asks for summaries, a window that has to move is first owed one: `view` is then the prompt that asks for it, and
`answer` takes the summary. Neither the question nor the longest answer can overflow a prompt, because a window that
moves leaves room for both.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Iterable, Sequence
from dataclasses import replace

from smartplay_tools.context.base import Window
from smartplay_tools.context.prompts.wording import VERSION, Wording
from smartplay_tools.context.strategies import Strategies
from smartplay_tools.context.strategies.base import share_kept
from smartplay_tools.context.tokens import PRIMING, TokenCounter
from smartplay_tools.context.turns import Turn
from smartplay_tools.context.view import View
from smartplay_tools.context.window_state import Contents, WindowState
from smartplay_tools.errors import PromptOverflowError
from smartplay_tools.transcript.events import Event
from smartplay_tools.types import ResolvedBudget, ToolSpec
from smartplay_tools.types.messages import Message


class ContextWindow(Window):
    """Selects turns for prompts: the newest that fit and are not too old, and those that are pinned."""

    def __init__(
        self,
        head: Sequence[Message],
        tools: Sequence[ToolSpec],
        budget: ResolvedBudget,
        counter: TokenCounter,
        strategies: Strategies | None = None,
    ) -> None:
        """`strategies` are the episode's own; by default they are made from the budget, with the newest words."""
        strategies = strategies or Strategies(budget, counter, Wording.of(VERSION))
        self._reserve, self._ageing, self._form = strategies.reserve, strategies.ageing, strategies.summaries
        self._share = share_kept(budget.slack)
        self._stretches = self._ageing.stretches(budget.history)
        self._overflows = False
        self._before: Contents | None = None
        self._leaving: Contents | None = None
        """The contents of the prompt that asks for a summary, while the window is owed one."""
        self.summaries = 0
        """How many summaries there have been."""
        super().__init__(head, tools, budget, counter, strategies)

    @classmethod
    def of(
        cls,
        turns: Iterable[Turn],
        head: Sequence[Message],
        tools: Sequence[ToolSpec],
        budget: ResolvedBudget,
        counter: TokenCounter,
    ) -> ContextWindow:
        """Return the window after these turns, none of which was followed by a summary."""
        window = cls(head, tools, budget, counter)
        for turn in turns:
            window.append(turn)
        return window

    def _begin(self, state: WindowState) -> None:
        self._now = Contents(state, state.selected(0))

    def append(self, turn: Turn) -> None:
        """Add a complete turn and decide what is shown after it, and whether a summary is asked for first."""
        before, self._before, self._leaving = self._now, self._now, None
        summary, was_first = before.summary, before.selection.first
        state = self._after(turn, before.state)
        self._stretches.append(state.last, has_step=turn.step > before.state.step)
        self._anchor(state)
        first = self._first(state, was_first, 0 if summary is None else summary.tokens)
        self._now = Contents(state, state.selected(first), summary)
        if self._form is not None and first > max(was_first, state.anchors) and not self._overflows:
            leaving = replace(before.selection, last=first - 1)
            self._leaving = Contents(before.state, leaving, summary, self._form.question)

    def view(self) -> View:
        """Return the next prompt: to play, or for a summary where the window is owed one.

        The prompt for a summary is the last one to play without the turns that stay, and a question. If the pinned
        parts of a prompt do not fit, this is a `PromptOverflowError`.
        """
        if self._overflows:
            state = self._now.state
            tokens = state.tokens(state.last) + self._reserve
            raise PromptOverflowError(f"The pinned parts of the prompt take {tokens} tokens.")
        before, contents = self._before, self._leaving or self._now
        state, chosen, question = contents.state, contents.selection, contents.question
        tokens = state.selection_tokens(chosen) + (0 if contents.summary is None else contents.summary.tokens)
        prefix = 0
        if question is not None:
            prefix = tokens - PRIMING
            tokens += question.tokens(self._counter)
        elif before is not None:
            own = tokens - state.head.tokens
            prefix = self._prefix(before.state.head, before.forms, state.head, contents.forms, own)
        return View(
            tools=self._tools,
            tokens=tokens,
            shown_steps=state.visible(chosen),
            dropped_turns=state.turns - len(chosen),
            prefix_tokens=prefix,
            selection=chosen,
            forms=[*state.head.forms, *contents.forms],
            turns=self._index.turns,
            purpose="play" if question is None else "summary",
            summaries=self.summaries,
        )

    def answer(self, reply_text: str) -> Event:
        """Take a summary; return what is shown of it and from where on turns stay, for the record.

        An answer of which nothing is left to show leaves the earlier summary as it is; the turns still leave.
        """
        assert self._leaving is not None
        assert self._form is not None
        self._leaving = None
        self.summaries += 1
        was = self._now.summary
        if (text := self._form.cut(reply_text)) and (was is None or was.text != text):
            self._now = replace(self._now, summary=self._form.show(text))
        summary = self._now.summary
        shown = {"text": "", "tokens": 0} if summary is None else {"text": summary.text, "tokens": summary.tokens}
        is_cut = text != reply_text and bool(reply_text.strip())
        return {"covers": self._now.selection.first, **shown, "cut": is_cut, "empty": not text}

    def _anchor(self, state: WindowState) -> None:
        """Pin as many of the first turns as fit beside the other pinned parts."""
        if most := self._strategies.first_turns:
            cap = self.budget.prompt_tokens
            state.pin_first(most, math.inf if cap is None else cap - self._reserve)

    # Selection of the turns to keep.

    def _first(self, state: WindowState, before: int, summary: int) -> int:
        """The first turn to keep, given the one before this turn: with slack it stays while the limits hold."""
        if self._share != 1 and self._holds(state, before, summary):
            self._overflows = False
            return before
        cap, pins = self.budget.prompt_tokens, state.tokens(state.last)
        self._overflows = cap is not None and pins + self._reserve > cap
        return state.last if self._overflows else self._fill(state, before, pins)

    def _holds(self, state: WindowState, first: int, summary: int) -> bool:
        """Whether the view that begins at `first` is within the limits, and leaves room to ask for another summary."""
        cap, question = self.budget.prompt_tokens, 0 if self._form is None else self._form.question_tokens
        if self._ageing.drops and first < max(state.boundary, self._stretches.first):
            return False
        return cap is None or state.tokens(first) + question + summary <= cap

    def _fill(self, state: WindowState, before: int, pins: int) -> int:
        """Return the first turn to keep when unpinned turns may take a share of the room and of the history.

        `before` is the one before this turn, and `pins` are the tokens of the pinned parts.
        """
        history, cap, last, low = self.budget.history, self.budget.prompt_tokens, state.last, 0
        if history is not None and self._ageing.drops:
            low = min(last, self._index.first_from(state.step - math.ceil(self._share * history)))
            low = max(low, self._stretches.first_after_move)
        if cap is None:
            return low
        most = pins + math.floor(self._share * (cap - self._reserve - pins))

        def first_that_fits(low: int, high: int) -> int:
            """From `high` back the total only grows: search for where it passes the room, first near where it did."""
            near, step = min(max(low, before), high), 1
            while near < high and state.tokens(near) > most:
                low, near, step = near + 1, min(near + step, high), 2 * step
            return low + bisect_left(range(low, near), x=True, key=lambda at: state.tokens(at) <= most)

        notes = state.notes
        if notes is None or notes < low:
            return first_that_fits(low, last)
        first = first_that_fits(notes + 1, last)
        if first > notes + 1 or state.tokens(notes) > most:
            return first
        return first_that_fits(low, notes)
