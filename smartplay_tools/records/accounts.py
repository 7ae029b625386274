"""Accounts: where the tokens of an episode's prompts went, and why turns left them, counted again from its record.

Budget tokens of messages add up, so a prompt is the sum of its parts to the token, and what a turn would have needed is
known for prompts that it was not in. Only records of conversations that were counted with a tokenizer of this package
have accounts: any other would have to be named by the reader. `shown_turns` needs no tokenizer: it says what a
prompt showed of each turn before it, as a word for each turn.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial, reduce
from itertools import repeat
from operator import add, sub
from typing import Literal

from smartplay_tools.context.prefix import common_beginning
from smartplay_tools.context.rewriting import SYSTEM
from smartplay_tools.context.strategies.ageing import drops_old_turns
from smartplay_tools.context.strategies.summaries import summaries_of
from smartplay_tools.context.tokens import PRIMING
from smartplay_tools.context.tokens.counter import shared_counter
from smartplay_tools.context.tokens.tokenizers import ships
from smartplay_tools.context.turns import Form, Item, Turn
from smartplay_tools.context.view import numbers_in
from smartplay_tools.context.window import ContextWindow
from smartplay_tools.records.prompts import Rebuilder, oldest_of, rewritten_prompts, selection_of
from smartplay_tools.records.record import Record
from smartplay_tools.transcript.events import Event, ViewEvent, concerns_summary, purpose_of
from smartplay_tools.types import NOTES_TOOL, ResolvedBudget
from smartplay_tools.types.messages import Message, reasoning_of, text_of

PARTS = {
    "task": "task and tools",
    "manual": "manual",
    "summary": "summary",
    "notes": "notes",
    "words": "its own words",
    "calls": "its own calls",
    "observations": "observations",
    "masked": "markers of masked observations",
    "other": "other results",
    "texts": "texts of the strategy",
}
"""The parts of a prompt and their names, in the order in which they are counted and drawn. The manual is a part once it
was read; the summary includes the request for one; notes are the calls that take them."""

_TASK, _MANUAL, _SUMMARY, _NOTES, _WORDS, _CALLS, _OBSERVATIONS, _MASKED, _OTHER, _TEXTS = range(len(PARTS))

Tokens = list[int]
"""A number of tokens for each of `PARTS`."""

Reason = Literal["history", "full", "block", "pin", "choice"]


@dataclass(frozen=True)
class Departure:
    """A turn that a prompt no longer showed."""

    turn: int
    prompt: int
    """The turn whose prompt was the first without it."""
    reason: Reason
    """It was older than the history; it did not fit; slack dropped more at once than had to go; it was no longer
    pinned; a custom strategy did not choose it."""
    needs: int
    """The tokens that it would have taken."""
    age: int
    """How many observations its newest one was behind the current one."""
    free: int | None = None
    """If it did not fit: the tokens that were free. Without slack only."""
    keeps: int | None = None
    """The smallest history or cap on prompts (`reason` says which) that would have kept the turn.

    With slack it is what the prompt needed with all its turns: a larger cap has other blocks.
    """


class Accounts:
    """The accounts of one record."""

    def __init__(self, record: Record) -> None:
        self._record = record
        self._counter = shared_counter(record.config.tokenizer, record.config.prompts)
        self._budget = ResolvedBudget(**record.budget)
        words = record.config.words
        self._has_grid = words.has_grid
        self._drops, self._form = drops_old_turns(self._budget), summaries_of(self._budget, self._counter, words)
        self._turns = record.turns
        self._summed, self._sums = list[Form](), [[0] * len(PARTS)]
        """The messages of the conversation that were summed up, and the parts of those before each."""
        self._replies: dict[Form, Tokens] = {}
        """The parts of the replies, as they were said or trimmed."""
        self._manuals: dict[Form, int] = {}
        """What a manual, or the newest notes, add to the system message."""

    @classmethod
    def of(cls, record: Record) -> Accounts | None:
        """Return the accounts of a record; None if it has none."""
        if record.is_paper or not record.views or not ships(record.config.tokenizer):
            return None
        return cls(record)

    def sizes(self) -> Iterator[tuple[int, int]]:
        """Yield the tokens of each turn, unmasked and with every observation masked."""
        for turn in self._turns:
            yield self._sum(turn.whole), self._sum(turn.masked)

    def prompts(self) -> Iterator[Tokens]:
        """Yield the tokens of the parts of every prompt, in their order."""
        rebuilder = Rebuilder(self._record.events, self._turns)
        yield from rebuilder.each(partial(self._parts, rebuilder))

    def _parts(self, rebuilder: Rebuilder, view: Event) -> Tokens:
        chosen, window, tokens = rebuilder.reach(view), rebuilder.window, [0] * len(PARTS)
        self._sum_up(window)
        for piece in chosen.pieces:
            if isinstance(piece, Form):
                tokens[_TEXTS if self._form is None else _SUMMARY] += window.text(piece).tokens(self._counter)
            else:
                tokens = _plus(tokens, self._row(piece))
        for number in chosen.masked if chosen.pinned is None else {*chosen.masked, chosen.pinned}:
            row = window.row(number, number + 1)
            parts = map(self._parts_of, repeat(window), row, chosen.seen(self._turns[number]))
            tokens = _minus(reduce(_plus, parts, tokens), self._row(row))
        if purpose_of(view) == "compaction":
            tools = window.tools_beside(window.forms(chosen))
        else:
            head, tools = self._record.head_of[view["turn"]], window.tools
            more = sum(map(self._manual, head["messages"], window.head))
            tokens[_TASK] += self._sum(window.head) - more
            tokens[_NOTES if head.get("compacts") else _MANUAL] += more
        tokens[_TASK] += PRIMING + self._counter.tools(tools)
        return tokens

    def _sum_up(self, window: ContextWindow) -> None:
        """Sum up the parts of the messages of the conversation, as they are now, from the first that has changed."""
        same = common_beginning(window.now, self._summed)
        del self._summed[same:], self._sums[same + 1 :]
        for number, form in enumerate(window.now[same:], start=same):
            self._summed.append(form)
            self._sums.append(_plus(self._sums[-1], self._parts_of(window, number, form)))

    def _row(self, row: range) -> Tokens:
        """The parts of messages in a row."""
        return _minus(self._sums[row.stop], self._sums[row.start])

    def _parts_of(self, window: ContextWindow, number: int, form: Form) -> Tokens:
        """The parts of a message in one of its forms."""
        turn, item = window.turn_of(number), window.item(number)
        if turn >= 0 and item is None:
            return self._parts_of_reply(self._turns[turn], form)
        tokens = [0] * len(PARTS)
        tokens[_TASK if item is None else _part_of(item, form)] = form.tokens(self._counter)
        return tokens

    def _manual(self, plain: Message, shown: Form) -> int:
        """What the manual adds to a message of the head, if that is the system message."""
        if plain["role"] not in SYSTEM:
            return 0
        if shown not in self._manuals:
            self._manuals[shown] = shown.tokens(self._counter) - self._counter.message(plain)
        return self._manuals[shown]

    def _parts_of_reply(self, turn: Turn, form: Form) -> Tokens:
        """The parts of a turn's reply as it was said, or as it is shown trimmed."""
        if form not in self._replies:
            tokens = self._replies[form] = [0] * len(PARTS)
            words = {name: value for name, value in form.message.items() if name != "tool_calls"}
            tokens[_WORDS if text_of(words) or reasoning_of(words) else _CALLS] = self._counter.message(words)
            for call, arguments in zip(turn.calls, turn.arguments, strict=True):
                tokens[_NOTES if call.name == NOTES_TOOL else _CALLS] += self._counter.call(call.name, arguments)
        return self._replies[form]

    def departures(self) -> Iterator[Departure]:
        """Yield every turn that left, in the order of the prompts."""
        before: ViewEvent | None = None
        for view in self._record.views:
            if not concerns_summary(view):
                if before is not None:
                    yield from self._left(before, view)
                before = view

    def _left(self, before: ViewEvent, view: ViewEvent) -> Iterator[Departure]:
        """Yield the turns that one prompt showed and the next one did not."""
        shown = set(numbers_in(view["turns"]))
        gone = [turn for turn in numbers_in(before["turns"]) if turn not in shown]
        if not gone:
            return
        turns, budget, cap = self._turns, self._budget, self._budget.prompt_tokens
        step = turns[view["turn"] - 1].step
        run = before["turns"][-1][0]
        """The first turn of the run that moved on; turns before it were pinned."""
        history = budget.history if self._drops else None
        oldest = oldest_of(view, turns)
        needs = {turn: self._needs(turns[turn], oldest, view) for turn in gone}
        unmoved = view["tokens"] - self._summary(view) + sum(needs.values()) + self._kept_free(before)
        room = None if cap is None else cap - view["tokens"]
        for turn in reversed(gone):
            age = step - turns[turn].step
            left = partial(Departure, turn=turn, prompt=view["turn"], needs=needs[turn], age=age)
            if budget.strategy is not None:
                yield left(reason="choice")
            elif turn < run:
                yield left(reason="pin")
            elif history is not None and age > history:
                yield left(reason="history", keeps=age)
            elif budget.slack == 0 and cap is not None and room is not None:
                yield left(reason="full", free=room, keeps=cap + needs[turn] - room)
            elif cap is not None and unmoved > cap:
                yield left(reason="full", keeps=unmoved)
            else:
                yield left(reason="block")
            if room is not None:
                room -= needs[turn]

    def _kept_free(self, before: ViewEvent) -> int:
        """The tokens of a question for a summary and of the longest answer; by the fold, of the summary that stays."""
        if self._form is None:
            return 0
        return self._form.reserve if self._has_grid else self._form.question_tokens + self._summary(before)

    def _needs(self, turn: Turn, oldest: int, view: ViewEvent) -> int:
        """The tokens that a turn would take in a prompt."""
        return self._sum(turn.seen(oldest, trimmed_before=view.get("words", 0), elided=view.get("pictures", 0)))

    def _summary(self, view: ViewEvent) -> int:
        """The tokens of the summary that a prompt showed."""
        if self._form is None or not (number := view.get("summary", 0)):
            return 0
        text = self._record.summaries[number - 1]["text"]
        return self._form.show(text).tokens if text else 0

    def _sum(self, forms: Iterable[Form]) -> int:
        return sum(form.tokens(self._counter) for form in forms)


def _plus(tokens: Tokens, more: Tokens) -> Tokens:
    return list(map(add, tokens, more))


def _minus(tokens: Tokens, fewer: Tokens) -> Tokens:
    return list(map(sub, tokens, fewer))


def _part_of(item: Item, form: Form) -> int:
    """The part of a prompt that an item is, in one of its forms."""
    if item.date is None:
        return _OTHER
    return _MASKED if form.message is item.masked else _OBSERVATIONS


ShownAs = Literal["whole", "trimmed", "masked", "notes", "pinned", "gone"]
"""In full; without the words of its reply; with an observation masked; only for its notes; only because a strategy has
pinned it; not at all."""


def shown_turns(record: Record, view: ViewEvent) -> list[ShownAs]:
    """Return how a prompt showed every turn before it. An episode in the paper's protocol has no turns.

    Where a compactor has rewritten the history, a turn of which only some messages were shown counts as masked.
    """
    shown: list[ShownAs] = ["gone"] * view["turn"]
    if record.is_paper:
        return shown
    turns, chosen = record.turns, selection_of(view, record.turns)
    rewritten = (each for each in rewritten_prompts(record.events, turns) if each[0]["turn"] == view["turn"])
    forms = next(({*window.forms(pieces)} for _, window, pieces in rewritten), None)
    for number in chosen:
        if number >= view["turn"]:  # a request for a summary is about the turn before it
            continue
        turn = turns[number]
        if number == chosen.pinned:
            shown[number] = "pinned" if view.get("notes") is None else "notes"
        elif chosen.masked_items(turn) or (forms is not None and not forms.issuperset(turn.whole)):
            shown[number] = "masked"
        else:
            shown[number] = "trimmed" if turn.step < chosen.trimmed_before else "whole"
    return shown
