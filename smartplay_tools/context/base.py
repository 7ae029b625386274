"""The base of the windows: the turns with their tokens, what is too old, what is pinned, and the tokens of the prefix.

A window decides what every prompt of a conversation shows. There are three kinds: `window` selects the turns itself, in
`choosing` a custom strategy selects them, and in `compacting` a compactor rewrites the history.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

from smartplay_tools.context.prefix import common_beginning, common_head
from smartplay_tools.context.strategies import Strategies
from smartplay_tools.context.token_index import TokenIndex
from smartplay_tools.context.tokens import PRIMING, TokenCounter
from smartplay_tools.context.turns import Form, Turn
from smartplay_tools.context.view import Head, View, with_manual
from smartplay_tools.context.window_state import WindowState
from smartplay_tools.transcript.events import Event
from smartplay_tools.types import ResolvedBudget, ToolSpec
from smartplay_tools.types.messages import Message


class Window(ABC):
    """Decides what the prompts of a conversation show: `append` adds a turn, `view` returns the next prompt."""

    def __init__(
        self,
        head: Sequence[Message],
        tools: Sequence[ToolSpec],
        budget: ResolvedBudget,
        counter: TokenCounter,
        strategies: Strategies,
    ) -> None:
        self.budget, self._counter, self._strategies = budget, counter, strategies
        stripping, picturing = strategies.stripping, strategies.picturing
        self._index = TokenIndex(counter, with_words=stripping is not None, with_pictures=picturing is not None)
        self._newest: int | None = None
        self.change_head(head, tools)

    def change_head(self, head: Sequence[Message], tools: Sequence[ToolSpec], *, begins: bool = True) -> None:
        """Begin all further views with another head and other tools, from the next appended turn on.

        With `begins` so does the view before the first turn, which was not sent yet.
        """
        self._tools, self._tools_tokens = tuple(tools), self._counter.tools(tools)
        self._plain_head, self._heads = list(head), dict[str | None, Head]()
        if begins and not self._index.turns:
            self._begin(WindowState.after(self._index, 0, None, self._head(None)))

    @abstractmethod
    def _begin(self, state: WindowState) -> None:
        """Decide what is shown before the first turn."""

    @abstractmethod
    def append(self, turn: Turn) -> None:
        """Add a complete turn and decide what is shown after it."""

    @abstractmethod
    def view(self) -> View:
        """Return the next prompt: to play, or for words that are needed first, as its purpose says.

        `PromptOverflowError` if what every prompt shows does not fit; `StrategyError` if a custom strategy fails.
        """

    def answer(self, reply_text: str) -> Event:
        """Take the reply to a prompt for words; return what the record needs of it.

        Only windows that ask for words have it.
        """
        raise NotImplementedError

    @property
    def turns(self) -> Sequence[Turn]:
        """Every turn that was appended."""
        return self._index.turns

    def _after(self, turn: Turn, before: WindowState) -> WindowState:
        """Add a turn; return what is old and what is pinned after it."""
        self._index.append(turn)
        if turn.shows and turn.shows[-1] == turn.step:
            self._newest = len(self._index.turns) - 1
        strategies, words, pictures = self._strategies, 0, 0
        oldest = strategies.ageing.oldest(turn.step, self.budget.history, before.oldest)
        if strategies.stripping is not None:
            words = strategies.stripping.bare(turn.step, before.words)
        if strategies.picturing is not None:
            pictures = strategies.picturing.left_out(turn.first_picture + len(turn.pictured), before.pictures)
        state = WindowState.after(self._index, oldest, self._newest, self._head(turn.manual), words, pictures)
        if strategies.pinning is not None:
            self._pin(state, strategies.pinning.pinned(turn))
        return state

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
        if cap is None or state.tokens(state.last) + state.masked(notes) + self._strategies.reserve <= cap:
            state.notes = notes

    def _prefix(
        self,
        was: Head,
        before: Sequence[Form],
        head: Head,
        forms: Sequence[Form],
        tokens: int,
        *,
        is_equal: bool = False,
    ) -> int:
        """The tokens at the beginning of a prompt that are the same in the one before: head, then messages.

        `tokens` are those of the messages. With `is_equal` a message is the same if it says the same, and not only if
        it is in the same place of the conversation.
        """
        shared, is_same = common_head(was, head, self._tools_tokens, self._counter)
        same = common_beginning(forms, before, is_equal=is_equal) if is_same else 0
        if 2 * same < len(forms):
            return shared + sum([form.tokens(self._counter) for form in forms[:same]])
        return shared + tokens - sum([form.tokens(self._counter) for form in forms[same:]])
