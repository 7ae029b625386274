"""The context window: what the model may see, as a pure function of the turns, the budget and the tokenizer.

A view is the head (system, task, manual once read), the pinned turns (the newest one, and the latest that shows the
newest observation) and older turns, newest first, as long as they fit and are not too old. Two rules are absolute: no
view is longer than `prompt_tokens`, and no observation in it is older than `history` steps.

Why a view is cheap. Steps never go back, so among the turns young enough to be kept only the oldest, the border, can
hold an observation that must be marked; and a run of turns costs a difference of two running sums. Finding the first
turn to keep is then a bisection, at any length of the episode.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import islice, takewhile

from smartplay_tools.errors import PromptOverflowError
from smartplay_tools.messages import Message, text_of
from smartplay_tools.records import ResolvedBudget, ToolSpec
from smartplay_tools.tokens import PRIMING, TokenCounter
from smartplay_tools.turns import Turn, Turns


@dataclass(frozen=True)
class Kept:
    """Which turns a view shows: `first` to `last`, and before them the pinned one if it is older than `first`."""

    pinned: int | None
    first: int
    last: int
    oldest: int
    """Observations before this one are marked."""

    def __iter__(self) -> Iterator[int]:
        if self.pinned is not None:
            yield self.pinned
        yield from range(self.first, self.last + 1)

    def __len__(self) -> int:
        return (self.pinned is not None) + self.last + 1 - self.first


@dataclass(frozen=True)
class View:
    """A prompt, and what it leaves out."""

    messages: list[Message]
    """Head and turns, in chronological order. The list is yours; the messages are not to be edited."""
    tools: tuple[ToolSpec, ...]
    tokens: int
    """Budget tokens of the whole prompt: tools, messages, priming."""
    shown_steps: int
    """How many observations the view reaches back, the current one included; 0 before the first."""
    dropped_turns: int
    marked_results: tuple[tuple[int, int], ...]
    """(turn, item) of every result in the view whose observation has left the window."""
    prefix_tokens: int
    """Tokens at the beginning that are the same, in whole messages, in the view of one turn less."""
    kept: Kept
    """Which turns the view shows."""


@dataclass(frozen=True)
class _Moment:
    """What the turns up to a moment say about it, before any choice."""

    last: int
    step: int
    """t, the newest observation shown so far."""
    oldest: int
    """t - history: what is older is not shown."""
    pinned: int | None
    """The latest turn that shows observation t."""
    border: int
    """The first turn that is not all older than `oldest`: the only one that can be partly too old."""
    saved: int
    """The tokens that marking the border's old observations saves; less than 0 where the marker is the longer."""
    head: int
    """Tokens of head, tools and priming."""


class ContextWindow:
    """Turns in, views out. It remembers running sums of the turns it has seen, and nothing that changes an answer."""

    def __init__(
        self, head: Sequence[Message], tools: Sequence[ToolSpec], budget: ResolvedBudget, counter: TokenCounter
    ) -> None:
        self.budget = budget
        self._counter = counter
        self._tools = tuple(tools)
        self._tools_tokens = counter.tools(tools)
        self._share = 1 - Fraction(str(budget.slack))
        self._heads: dict[str | None, tuple[list[Message], int]] = {}
        self._plain_head = list(head)
        self._forget(Turns())

    def view(self, turns: Sequence[Turn]) -> View:
        """Return what the model may see after these turns; `PromptOverflowError` if the pinned parts do not fit.

        A function of turns, budget and tokenizer alone: it does not matter which views were taken before. Turns in a
        `Turns` are read once; any other sequence is read anew.
        """
        self._read(turns if isinstance(turns, Turns) else Turns(turns))
        now = self._moment(len(turns))
        kept = self._kept(now)
        tokens = self._total(now, kept.first)
        if self.budget.prompt_tokens is not None and tokens > self.budget.prompt_tokens:
            raise PromptOverflowError(f"The pinned parts of the prompt take {tokens} tokens.")
        messages = self.head(now.last).copy()
        for index in kept:
            turn = self._log[index]
            messages.extend(turn.messages if index != now.border else turn.seen(now.oldest))
        # Only the first turn of a view can be the border: see `_Moment`.
        marked = (
            self._log[now.border].marked(now.oldest) if len(kept) and now.border in (kept.pinned, kept.first) else []
        )
        return View(
            messages=messages,
            tools=self._tools,
            tokens=tokens,
            shown_steps=self._reach(now, kept),
            dropped_turns=len(turns) - len(kept),
            marked_results=tuple((now.border, item) for item in marked),
            prefix_tokens=self._prefix(now, kept),
            kept=kept,
        )

    def head(self, last: int) -> list[Message]:
        """Return the first messages of the view after turn `last`: the manual ends the system message once read."""
        return self._head(last)[0]

    def _head(self, last: int) -> tuple[list[Message], int]:
        manual = None
        if self._manual is not None and self._manual[0] <= last:
            manual = self._manual[1]
        if manual not in self._heads:
            head = self._plain_head if manual is None else with_manual(self._plain_head, manual)
            tokens = self._counter.messages(head) + self._tools_tokens + PRIMING
            self._heads[manual] = (head, tokens)
        return self._heads[manual]

    # What is remembered of the turns.

    def _forget(self, turns: Turns) -> None:
        self._log = turns.log
        self._sums = [0]
        """Tokens of the first n turns, unmarked."""
        self._steps: list[int] = []
        self._pins: list[int | None] = []
        """For every turn the latest one up to it that shows the newest observation."""
        self._manual: tuple[int, str] | None = None
        """The turn that read the manual first, and the manual."""
        self._firsts: list[int] = []
        """For every turn the first one kept after it, where slack makes that depend on the past."""

    def _read(self, turns: Turns) -> None:
        if turns.log is not self._log:
            self._forget(turns)
        for index in range(len(self._steps), len(turns)):
            turn = turns[index]
            self._sums.append(self._sums[-1] + sum(map(self._counter.message, turn.messages)))
            self._steps.append(turn.step)
            shows_newest = any(item.observation == turn.step for item in turn.items)
            self._pins.append(index if shows_newest else self._pins[-1] if self._pins else None)
            for item in turn.items:
                if item.manual is not None and self._manual is None:
                    self._manual = (index, item.manual)

    def _moment(self, length: int) -> _Moment:
        last = length - 1
        step = self._steps[last] if length else 0
        history = self.budget.history
        oldest = 0 if history is None else max(0, step - history)
        border = bisect_left(self._steps, oldest, hi=length)
        saved = self._saved(self._log[border], oldest) if border < length else 0
        pinned = self._pins[last] if length else None
        return _Moment(last, step, oldest, pinned, border, saved, head=self._head(last)[1])

    def _saved(self, turn: Turn, oldest: int) -> int:
        count = self._counter.message
        items = [turn.items[at] for at in turn.marked(oldest)]
        return sum(count(item.message) - count(item.marked) for item in items)

    # What is kept.

    def _kept(self, now: _Moment) -> Kept:
        first = self._first(now) if now.last >= 0 else 0
        pinned = now.pinned if now.pinned is not None and now.pinned < first else None
        return Kept(pinned, first, now.last, now.oldest)

    def _total(self, now: _Moment, first: int) -> int:
        """Tokens of the view that keeps the turns from `first` on, and the pinned ones."""
        total = now.head + self._sums[now.last + 1] - self._sums[first]
        if now.pinned is not None and now.pinned < first:
            total += self._cost(now.pinned)
        return total - now.saved if now.border >= first or now.border == now.pinned else total

    def _cost(self, index: int) -> int:
        return self._sums[index + 1] - self._sums[index]

    def _first(self, now: _Moment) -> int:
        if self._share == 1:
            return self._fill(now, self._share)
        # A fold over all prefixes, so that it does not matter at which of them a view was taken.
        for length in range(len(self._firsts) + 1, now.last + 2):
            then = self._moment(length)
            first = self._firsts[-1] if self._firsts else 0
            self._firsts.append(first if self._holds(then, first) else self._fill(then, self._share))
        return self._firsts[now.last]

    def _holds(self, now: _Moment, first: int) -> bool:
        """Whether the view that begins at `first` is within the limits."""
        cap = self.budget.prompt_tokens
        fits = cap is None or self._total(now, first) <= cap
        return fits and (first >= now.border or first in (now.last, now.pinned))

    def _fill(self, now: _Moment, share: Fraction) -> int:
        """Return the first turn to keep when unpinned turns may take a share of the room and of the history."""
        history, cap, low = self.budget.history, self.budget.prompt_tokens, 0
        if history is not None:
            low = bisect_left(self._steps, now.step - math.ceil(share * history), hi=now.last)
        if cap is None:
            return low
        pins = self._total(now, now.last)
        if pins > cap:
            return now.last
        room = share * (cap - pins)
        # From the newest turn back the total only grows: bisect for where it passes the room.
        return low + bisect_left(range(low, now.last), x=True, key=lambda at: self._total(now, at) - pins <= room)

    # What is reported.

    def _reach(self, now: _Moment, kept: Kept) -> int:
        for index in kept:
            for item in self._log[index].items:
                if item.observation is not None and item.observation >= now.oldest:
                    return now.step - item.observation + 1
        return 0

    def _prefix(self, now: _Moment, kept: Kept) -> int:
        """Compare with the view of one turn less, whether or not it was ever taken."""
        if now.last < 0:
            return 0
        count = self._counter.message
        before = self._moment(now.last)
        head, head_before = self.head(now.last), self.head(before.last)
        if head is not head_before:
            same = takewhile(lambda pair: pair[0] == pair[1], zip(head, head_before, strict=True))
            return self._tools_tokens + sum(count(message) for message, _ in same)
        shared = now.head - PRIMING
        kept_before = self._kept(before)
        start, *rest = [*islice(kept, 2)]
        if not len(kept_before) or [start] != [*islice(kept_before, 1)]:
            return shared
        turn = self._log[start]
        marked, marked_before = turn.marked(now.oldest), turn.marked(before.oldest)
        if marked != marked_before:
            changed = min(set(marked) ^ set(marked_before))
            return shared + sum(map(count, turn.seen(now.oldest)[: changed + 1]))
        shared += self._cost(start) - self._saved(turn, now.oldest)
        if rest == [*islice(kept_before, 1, 2)]:
            # After its first turn a view is a run of neighbours, so the older view goes on as this one does.
            shared += self._sums[before.last + 1] - self._sums[rest[0]]
        return shared


def with_manual(head: Sequence[Message], manual: str) -> list[Message]:
    """Return the head with the manual as the last part of its system message."""
    at = next(index for index, message in enumerate(head) if message["role"] in ("system", "developer"))
    system = head[at].copy()
    system["content"] = f"{text_of(system)}\n\n{manual}"
    return [*head[:at], system, *head[at + 1 :]]
