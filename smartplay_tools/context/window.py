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
them asks for summaries, a window that has to move is first owed one: `request` is the prompt that asks for it, and
`summarise` takes the answer. Neither the question nor the longest answer can overflow a prompt, because a window that
moves leaves room for both.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Iterable, Sequence
from dataclasses import replace

from smartplay_tools.context.prefix import common_tokens
from smartplay_tools.context.prompts.wording import VERSION, Wording
from smartplay_tools.context.strategies import Strategies
from smartplay_tools.context.strategies.base import Summary, share_kept
from smartplay_tools.context.token_index import TokenIndex
from smartplay_tools.context.tokens import PRIMING, TokenCounter
from smartplay_tools.context.turns import Turn
from smartplay_tools.context.view import Head, View, with_manual
from smartplay_tools.context.window_state import Contents, WindowState
from smartplay_tools.errors import PromptOverflowError
from smartplay_tools.transcript.hashing import head_bytes
from smartplay_tools.types import ResolvedBudget, ToolSpec
from smartplay_tools.types.messages import Message


class ContextWindow:
    """Selects turns for prompts: `append` adds a turn, `view` returns what the model may see."""

    def __init__(
        self,
        head: Sequence[Message],
        tools: Sequence[ToolSpec],
        budget: ResolvedBudget,
        counter: TokenCounter,
        strategies: Strategies | None = None,
    ) -> None:
        """`strategies` are the episode's own; by default they are made from the budget, with the newest words."""
        self._strategies = strategies or Strategies(budget, counter, Wording.of(VERSION))
        self._reserve = self._strategies.reserve
        self._ageing, self._form = self._strategies.ageing, self._strategies.summaries
        self.budget = budget
        self._counter = counter
        self._tools = tuple(tools)
        self._tools_tokens = counter.tools(tools)
        self._share = share_kept(budget.slack)
        self._plain_head = list(head)
        self._heads: dict[str | None, Head] = {}
        self._stripping = self._strategies.stripping
        self._picturing = self._strategies.picturing
        self._pinning = self._strategies.pinning
        with_pictures = self._picturing is not None
        self._index = TokenIndex(counter, with_words=self._stripping is not None, with_pictures=with_pictures)
        self._stretches = self._ageing.stretches(budget.history)
        self._newest: int | None = None
        self._overflows = False
        state = WindowState.after(self._index, 0, None, self._head(None))
        self._now = Contents(state, state.selected(0), None)
        self._before: Contents | None = None
        self._first_view: Contents | None = None
        """The contents of the view before the first turn, which another head does not change."""
        self._leaving: Contents | None = None
        """The contents of the prompt that asks for a summary, while the window is owed one."""
        self.summaries = 0
        """How many summaries there have been."""

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

    def append(self, turn: Turn) -> None:
        """Add a complete turn and decide what is shown after it, and whether a summary is asked for first."""
        summary, was_first = self._now.summary, self._now.selection.first
        state = self._after(turn)
        first = self._first(state, was_first, 0 if summary is None else summary.tokens)
        self._now = Contents(state, state.selected(first), summary)
        if self._form is not None and first > max(was_first, state.anchors) and not self._overflows:
            assert self._before is not None
            leaving = replace(self._before.selection, last=first - 1)
            self._leaving = Contents(self._before.state, leaving, summary, self._form.question)

    def _after(self, turn: Turn) -> WindowState:
        """Add a turn; return what is old and what is pinned after it."""
        self._before, self._leaving, before = self._first_view or self._now, None, self._now.state
        self._first_view = None
        self._index.append(turn)
        last = len(self._index.turns) - 1
        if turn.shows and turn.shows[-1] == turn.step:
            self._newest = last
        self._stretches.append(last, has_step=turn.step > before.step)
        oldest = self._ageing.oldest(turn.step, self.budget.history, before.oldest)
        words = 0 if self._stripping is None else self._stripping.bare(turn.step, before.words)
        pictures = 0
        if self._picturing is not None:
            shown = turn.first_picture + len(turn.pictured)
            pictures = self._picturing.left_out(shown, before.pictures)
        state = WindowState.after(self._index, oldest, self._newest, self._head(turn.manual), words, pictures)
        if self._pinning is not None:
            self._pin(state, self._pinning.pinned(turn))
        self._anchor(state)
        return state

    def change_head(self, head: Sequence[Message], tools: Sequence[ToolSpec], *, keeps_first_view: bool = True) -> None:
        """Begin all further views with another head and other tools, from the next appended turn on."""
        if not keeps_first_view:
            self._first_view = None
        self._tools, self._tools_tokens = tuple(tools), self._counter.tools(tools)
        self._plain_head, self._heads = list(head), {}
        if not self._index.turns:
            state = WindowState.after(self._index, 0, None, self._head(None))
            self._now = Contents(state, state.selected(0), None)

    @property
    def turns(self) -> Sequence[Turn]:
        """Every turn that was appended."""
        return self._index.turns

    @property
    def head(self) -> Head:
        """The first messages of the next view."""
        return self._now.state.head

    @property
    def first(self) -> int:
        """The first turn of the run: all earlier turns have left, but for those that are pinned."""
        return self._now.selection.first

    @property
    def is_owed_summary(self) -> bool:
        """Whether a summary is asked for before the next view."""
        return self._leaving is not None

    def view(self) -> View:
        """Return the contents of the next prompt to play; `PromptOverflowError` if the pinned parts do not fit."""
        contents = self._now
        if not self._index.turns:
            self._first_view = contents
        if self._overflows:
            tokens = contents.state.tokens(contents.state.last) + self._reserve
            raise PromptOverflowError(f"The pinned parts of the prompt take {tokens} tokens.")
        tokens = contents.state.selection_tokens(contents.selection)
        tokens += 0 if contents.summary is None else contents.summary.tokens
        prefix = 0
        if self._before is not None:
            prefix = common_tokens(self._before, contents, self._tools_tokens, self._counter)
        return self._view_of(contents, tokens, prefix)

    def request(self) -> View:
        """Return the prompt that asks for the summary: the last view without the turns that stay, and a question."""
        contents, form = self._leaving, self._form
        assert contents is not None
        assert form is not None
        shared = contents.state.selection_tokens(contents.selection) - PRIMING
        shared += 0 if contents.summary is None else contents.summary.tokens
        return self._view_of(contents, shared + form.question_tokens + PRIMING, shared)

    def summarise(self, reply_text: str) -> tuple[Summary | None, bool, bool]:
        """Take the answer to `request`; return the summary that is shown now, and whether the answer was cut, or empty.

        An answer of which nothing is left to show leaves the earlier summary as it is; the turns still leave.
        """
        assert self._leaving is not None
        assert self._form is not None
        self._leaving = None
        self.summaries += 1
        if text := self._form.cut(reply_text):
            self._now = replace(self._now, summary=self._form.show(text))
        return self._now.summary, text != reply_text and bool(reply_text.strip()), not text

    def canonical(self, view: View) -> list[bytes]:
        """Return the canonical JSON of the latest view's messages, of which the prompt's sha256 is made."""
        contents = self._leaving if view.asks_for_summary else self._now
        assert contents is not None
        lines = contents.state.head.canonical.copy()
        summary = () if contents.summary is None else (head_bytes(contents.summary.message),)
        lines += contents.state.lines(contents.selection, summary)
        if contents.question is not None:
            lines.append(head_bytes(contents.question))
        return lines

    def _view_of(self, contents: Contents, tokens: int, prefix: int) -> View:
        state, chosen = contents.state, contents.selection
        shown = list(state.head.messages)
        shown += state.messages(chosen, () if contents.summary is None else (contents.summary.message,))
        if contents.question is not None:
            shown.append(contents.question)
        return View(
            tools=self._tools,
            tokens=tokens,
            shown_steps=state.visible(chosen),
            dropped_turns=state.turns - len(chosen),
            prefix_tokens=prefix,
            selection=chosen,
            shown=tuple(shown),
            turns=self._index.turns,
            purpose="play" if contents.question is None else "summary",
            summaries=self.summaries,
        )

    # Facts that follow from the turns.

    def _head(self, manual: str | None) -> Head:
        if manual not in self._heads:
            messages = self._plain_head if manual is None else with_manual(self._plain_head, manual)
            tokens = self._counter.messages(messages) + self._tools_tokens + PRIMING
            self._heads = {manual: Head(tuple(messages), tokens, self._tools)}
        return self._heads[manual]

    def _pin(self, state: WindowState, notes: int | None) -> None:
        """Pin the notes if they fit beside the other pinned parts; the newest turn and the current one are pinned."""
        if notes is None or notes in (state.last, state.newest):
            return
        cap = self.budget.prompt_tokens
        if cap is None or state.tokens(state.last) + state.masked(notes) + self._reserve <= cap:
            state.notes = notes

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
        return state.last if self._overflows else self._fill(state, pins)

    def _holds(self, state: WindowState, first: int, summary: int) -> bool:
        """Whether the view that begins at `first` is within the limits, and leaves room to ask for another summary."""
        cap, question = self.budget.prompt_tokens, 0 if self._form is None else self._form.question_tokens
        if self._ageing.drops and first < max(state.boundary, self._stretches.first):
            return False
        return cap is None or state.tokens(first) + question + summary <= cap

    def _fill(self, state: WindowState, pins: int) -> int:
        """Return the first turn to keep when unpinned turns may take a share of the room and of the history.

        `pins` are the tokens of the pinned parts.
        """
        history, cap, last, low = self.budget.history, self.budget.prompt_tokens, state.last, 0
        if history is not None and self._ageing.drops:
            low = min(last, self._index.first_from(state.step - math.ceil(self._share * history)))
            low = max(low, self._stretches.first_after_move)
        if cap is None:
            return low
        most = pins + math.floor(self._share * (cap - self._reserve - pins))

        def first_that_fits(low: int, high: int) -> int:
            """From `high` back the total only grows: bisect for where it passes the room."""
            return low + bisect_left(range(low, high), x=True, key=lambda at: state.tokens(at) <= most)

        notes = state.notes
        if notes is None or notes < low:
            return first_that_fits(low, last)
        first = first_that_fits(notes + 1, last)
        if first > notes + 1 or state.tokens(notes) > most:
            return first
        return first_that_fits(low, notes)
