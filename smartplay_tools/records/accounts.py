"""Accounts: where the tokens of an episode's prompts went, and why turns left them, counted again from its record.

Budget tokens of messages add up, so a prompt is the sum of its parts to the token, and what a turn would have needed is
known for prompts that it was not in. Only records of conversations that were counted with a tokenizer of this package
have accounts: any other would have to be named by the reader. `shown_turns` needs no tokenizer: it says what a
prompt showed of each turn before it, as a word for each turn.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import accumulate, pairwise
from operator import add, sub
from typing import Literal

from smartplay_tools.context.choosing import text_message
from smartplay_tools.context.rewriting import flat
from smartplay_tools.context.strategies.ageing import drops_old_turns
from smartplay_tools.context.strategies.summaries import summaries_of
from smartplay_tools.context.tokens import PRIMING
from smartplay_tools.context.tokens.counter import shared_counter
from smartplay_tools.context.tokens.tokenizers import ships
from smartplay_tools.context.turns import Form, Item, Turn
from smartplay_tools.context.view import Selection, numbers_in, with_manual
from smartplay_tools.context.window import ContextWindow
from smartplay_tools.records.prompts import oldest_of, pinned_in, rewritten_prompts, selection_of
from smartplay_tools.records.record import Record
from smartplay_tools.transcript.events import HeadEvent, ViewEvent, concerns_summary
from smartplay_tools.types import NOTES_TOOL, ResolvedBudget, ToolSpec
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

_NOTHING: Tokens = [0] * len(PARTS)

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
        self._steps = [turn.step for turn in self._turns]
        self._replies = [self._parts_of_reply(turn, turn.shown) for turn in self._turns]
        """The parts of each turn's reply."""
        self._heads: dict[tuple[int, str | None], tuple[int, int]] = {}

    @classmethod
    def of(cls, record: Record) -> Accounts | None:
        """Return the accounts of a record; None if it has none."""
        if record.is_paper or not record.views or not ships(record.config.tokenizer):
            return None
        return cls(record)

    @cached_property
    def _whole(self) -> list[Tokens]:
        """The parts of the turns before each, unmasked."""
        return _sums(self._parts_of(turn, 0) for turn in self._turns)

    @cached_property
    def _hidden(self) -> list[Tokens]:
        """The parts of the turns before each, with every observation masked."""
        return _sums(self._parts_of(turn, turn.step + 1) for turn in self._turns)

    @cached_property
    def _spoken(self) -> list[Tokens]:
        """The tokens that trimmed replies save in the turns before each."""

        def saved(turn: Turn, whole: Tokens) -> Tokens:
            return _minus(whole, self._parts_of_reply(turn, turn.trimmed.message)) if turn.is_wordy else _NOTHING

        return _sums(map(saved, self._turns, self._replies))

    def sizes(self) -> Iterator[tuple[int, int]]:
        """Yield the tokens of each turn, unmasked and with every observation masked."""
        for sums in zip(pairwise(self._whole), pairwise(self._hidden), strict=True):
            whole, masked = (sum(after) - sum(before) for before, after in sums)
            yield whole, masked

    def parts(self, view: ViewEvent) -> Tokens:
        """Return the tokens of the parts of a prompt."""
        is_request = concerns_summary(view)
        seen = view["turn"] - is_request
        manual = self._turns[seen - 1].manual if seen else None
        tokens = _NOTHING.copy()
        head = self._record.head_of[view["turn"]]
        tokens[_TASK], tokens[_NOTES if head.get("compacts") else _MANUAL] = self._head(head, manual)
        if head.get("compacts"):
            return _plus(tokens, self._rewritten[view["turn"]])
        tokens[_SUMMARY] = self._summary(view) + (self._form.question_tokens if self._form and is_request else 0)
        oldest, pinned = oldest_of(view, self._turns), pinned_in(view)
        if self._budget.strategy is not None or view.get("pictures"):
            return self._parts_by_turn(view, tokens)
        spoken = bisect_left(self._steps, view.get("words", 0))
        for first, last in view["turns"]:
            if spoken > first:
                tokens = _minus(tokens, _minus(self._spoken[min(last + 1, spoken)], self._spoken[first]))
            if first == last == pinned:
                tokens = _plus(tokens, _minus(self._hidden[last + 1], self._hidden[first]))
                continue
            # Of all turns only the first that is not older can be masked in part.
            edge = min(max(bisect_left(self._steps, oldest), first), last + 1)
            if edge > first:
                tokens = _plus(tokens, _minus(self._hidden[edge], self._hidden[first]))
            if not oldest:
                tokens = _plus(tokens, _minus(self._whole[last + 1], self._whole[edge]))
            elif edge <= last:
                tokens = _plus(tokens, self._parts_of(self._turns[edge], oldest))
                tokens = _plus(tokens, _minus(self._whole[last + 1], self._whole[edge + 1]))
        return tokens

    def _parts_by_turn(self, view: ViewEvent, tokens: Tokens) -> Tokens:
        """Add the parts of turn after turn, and the texts that a custom strategy has chosen."""
        hidden = {*numbers_in(view.get("hidden", [])), pinned_in(view)}
        for number in numbers_in(view["turns"]):
            turn = self._turns[number]
            oldest = turn.step + 1 if number in hidden else view["oldest"]
            if turn.step < view.get("words", 0):
                tokens = _minus(tokens, _minus(self._spoken[number + 1], self._spoken[number]))
            tokens = _plus(tokens, self._parts_of(turn, oldest, view.get("pictures", 0)))
        for _, text in view.get("texts", []):
            tokens[_TEXTS] += self._counter.message(text_message(text))
        return tokens

    @cached_property
    def _rewritten(self) -> dict[int, Tokens]:
        """The parts of the prompts to play that a compactor has made, without their heads, by turn."""
        rewritten = rewritten_prompts(self._record.events, self._turns)
        return {view["turn"]: self._parts_of_pieces(window, chosen) for view, window, chosen in rewritten}

    def _parts_of_pieces(self, window: ContextWindow, chosen: Selection) -> Tokens:
        """The parts of what a compactor shows: messages of the conversation, and its own as texts."""
        tokens = _NOTHING.copy()
        for place, form in zip(flat(chosen.pieces), window.forms(chosen), strict=True):
            turn = -1 if isinstance(place, Form) else window.turn_of(place)
            item = None if isinstance(place, Form) else window.item(place)
            if turn >= 0 and item is None:
                tokens = _plus(tokens, self._replies[turn])
                continue
            part = _TEXTS if isinstance(place, Form) else _TASK
            tokens[part if item is None else _part_of(item, form)] += form.tokens(self._counter)
        return tokens

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
        spoken = turn.trimming_saves(self._counter) if turn.step < view.get("words", 0) else 0
        return sum(self._parts_of(turn, oldest, view.get("pictures", 0))) - spoken

    def _summary(self, view: ViewEvent) -> int:
        """The tokens of the summary that a prompt showed."""
        if self._form is None or not (number := view.get("summary", 0)):
            return 0
        text = self._record.summaries[number - 1]["text"]
        return self._form.show(text).tokens if text else 0

    def _head(self, head: HeadEvent, manual: str | None) -> tuple[int, int]:
        """The tokens of head, tools and priming, and those that the manual adds."""
        key = (self._record.heads.index(head), manual)
        if key not in self._heads:
            messages = head["messages"][:1] if head.get("compacts") else head["messages"]
            plain = self._counter.messages(messages)
            more = 0 if manual is None else self._counter.messages(with_manual(messages, manual)) - plain
            tools = self._counter.tools([ToolSpec(**tool) for tool in head["tools"]])
            self._heads[key] = (plain + tools + PRIMING, more)
        return self._heads[key]

    def _parts_of(self, turn: Turn, oldest: int, pictures: int = 0) -> Tokens:
        """The parts of a turn whose observations before `oldest` are masked, and whose first pictures are left out."""
        tokens = self._replies[turn.number].copy()
        for item, form in zip(turn.items, turn.seen(oldest, elided=pictures)[1:], strict=True):
            tokens[_part_of(item, form)] += form.tokens(self._counter)
        return tokens

    def _parts_of_reply(self, turn: Turn, reply: Message) -> Tokens:
        """The parts of a turn's reply as it was said, or as it is shown trimmed."""
        tokens = _NOTHING.copy()
        words = {name: value for name, value in reply.items() if name != "tool_calls"}
        tokens[_WORDS if text_of(words) or reasoning_of(words) else _CALLS] = self._counter.message(words)
        for call, arguments in zip(turn.calls, turn.arguments, strict=True):
            tokens[_NOTES if call.name == NOTES_TOOL else _CALLS] += self._counter.call(call.name, arguments)
        return tokens


def _part_of(item: Item, form: Form) -> int:
    """The part of a prompt that an item is, in one of its forms."""
    if item.date is None:
        return _OTHER
    return _MASKED if form.message is item.masked else _OBSERVATIONS


def _sums(parts: Iterable[Tokens]) -> list[Tokens]:
    """Return the sums of the parts before each place."""
    return list(accumulate(parts, _plus, initial=_NOTHING))


def _plus(tokens: Tokens, more: Tokens) -> Tokens:
    return list(map(add, tokens, more))


def _minus(tokens: Tokens, fewer: Tokens) -> Tokens:
    return list(map(sub, tokens, fewer))


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
