"""The context window: decides what the model may see, again after every turn, and makes the prompt that shows it.

A prompt has a head (system, task, the manual once it has been read), and after it messages of the conversation, each at
its level, and texts between them. What it shows is a `Selection`. By itself the window shows the newest turns and those
that are pinned (`context.newest`). A rule can select in its place: that of a strategy which chooses turns
(`context.choosing`), or of a compactor (`context.compacting`). No prompt is longer than `prompt_tokens`, and no
observation in it is older than `history` steps. A window needs no episode.

Messages are numbered (`context.numbered`), so deciding takes a few bisections, and a prompt the time to list what it
shows.

What is too old, what is pinned and what is kept free is decided by the strategies (`context.strategies`). Where one of
them asks for summaries, a window that has to move is first owed one: `view` is then the prompt that asks for it, and
`answer` takes the summary. Neither the question nor the longest answer can overflow a prompt, because a window that
moves leaves room for both.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import accumulate, takewhile
from types import MappingProxyType
from typing import Any, TypeAlias

from smartplay_tools.context.fold import FoldedTurns
from smartplay_tools.context.newest import NewestTurns
from smartplay_tools.context.numbered import NumberedMessages
from smartplay_tools.context.prefix import common_beginning
from smartplay_tools.context.prompts.wording import VERSION, Wording
from smartplay_tools.context.strategies import Strategies
from smartplay_tools.context.strategies.base import Summary
from smartplay_tools.context.tokens import PRIMING, TokenCounter
from smartplay_tools.context.turns import Form, Turn
from smartplay_tools.context.view import Selection, View, with_manual
from smartplay_tools.errors import PromptOverflowError, StrategyError
from smartplay_tools.transcript.events import Event
from smartplay_tools.types import ResolvedBudget, ToolSpec
from smartplay_tools.types.messages import Message, calls_of

Rule: TypeAlias = "Callable[[], Generator[View, Message | None, Selection]]"
"""Makes a prompt to play: yields the prompts of questions, is sent the replies, and returns what is shown."""


class ContextWindow(NumberedMessages):
    """Decides what the prompts of a conversation show: `append` adds a turn, `view` returns the next prompt."""

    def __init__(
        self,
        head: Sequence[Message],
        tools: Sequence[ToolSpec],
        budget: ResolvedBudget,
        counter: TokenCounter,
        strategies: Strategies | None = None,
        *,
        lead: Sequence[Message] = (),
        aged_task: Message | None = None,
    ) -> None:
        """`strategies` are the episode's own; by default they are made from the budget, with the newest words.

        `lead` are messages after the head that are not in every prompt, but numbered as those of turns are.
        `aged_task` takes the task's place in the head once the first observation, with which that ends, is too old.
        """
        super().__init__(budget, counter, strategies or Strategies(budget, counter, Wording.of(VERSION)), lead)
        self._aged_task = aged_task
        self.newest: int | None = None
        """The latest turn that shows the newest observation."""
        self.pinned: int | None = None
        """The turn that a strategy has pinned, of which every observation is masked before the run."""
        self._first_turns = 0
        """How many of the first turns stay."""
        self._pins, self._pins_before = list[int](), [0]
        """The turns that stay when they have left the run, and the tokens of those before each, and of all."""
        self._run = self._new_run()
        self._left = 0
        """The latest turn that a run has begun with: a summary has been asked for of the turns before it."""
        self._rule: Rule | None = None
        self._by_words = False
        """The rule that makes every prompt in place of the window, if there is one (`follow`)."""
        self._making: Generator[View, Message | None, Selection] | None = None
        """Makes the next prompt to play, and waits for the replies to questions."""
        self._reply: Message | None = None
        """The reply to the latest question, until the rule has it."""
        self._summary: Summary | None = None
        self.summaries = 0
        """How many summaries there have been."""
        self._before: View | None = None
        """The prompt to play before the latest turn; where a rule makes prompts, the latest one."""
        self._asking: View | None = None
        """The prompt that asks for a summary, while the window is owed one."""
        self._overflow: int | None = None
        """The tokens of what every prompt shows, if it does not fit."""
        self.change_head(head, tools)

    def _new_run(self) -> NewestTurns:
        asking, reserve = self.strategies.summaries, self.strategies.reserve
        if self.strategies.words.has_grid or not self.budget.slack:
            return NewestTurns(self.budget, reserve)
        return FoldedTurns(self.budget, reserve, 0 if asking is None else asking.question_tokens)

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

    def change_head(self, head: Sequence[Message], tools: Sequence[ToolSpec], *, begins: bool = True) -> None:
        """Begin all further views with another head and other tools, from the next appended turn on.

        With `begins` so does the view before the first turn, which was not sent yet.
        """
        self.tools, self.tools_tokens = tuple(tools), self.counter.tools(tools)
        self._plain_head, self._heads = list(head), dict[tuple[str | None, bool], tuple[list[Form], int]]()
        if begins and not self.turns:
            self.use_head(None)
            self._playing = self._played(Selection([range(0)]))

    def use_head(self, manual: str | None, oldest: int = 0) -> None:
        """Begin prompts with the head, which shows the manual once it has been read.

        `oldest` is the oldest observation that is not too old.
        """
        key = manual, self._aged_task is not None and oldest > 0
        if key not in self._heads:
            messages = list(self._plain_head)
            if self._aged_task is not None and oldest > 0:
                messages[1] = self._aged_task
            messages = messages if manual is None else with_manual(messages, manual)
            tokens = self.counter.messages(messages) + self.tools_tokens + PRIMING
            self._heads = {key: (list(map(Form, messages)), tokens)}
        self.head, self.head_tokens = self._heads[key]

    def add(self, turn: Turn) -> None:
        """Add a complete turn; nothing of it has aged, unless the words of no reply are shown."""
        super().add(turn)
        self.use_head(turn.manual, self.oldest)

    # What is shown.

    def follow(self, rule: Rule, *, by_words: bool = False) -> None:
        """Have a rule make every prompt to play in place of the window.

        With `by_words` a message is the same as in the prompt before if it says the same, and not only if it is in the
        same place of the conversation.
        """
        self._rule, self._by_words, self._before = rule, by_words, None

    def append(self, turn: Turn) -> None:
        """Add a complete turn and decide what is shown after it, and whether a summary is asked for first."""
        before = self.newest
        self.add(turn)
        if turn.shows and turn.shows[-1] == turn.step:
            self.newest = len(self.turns) - 1
        self.grow_old()
        self.use_head(turn.manual, self.oldest)
        self._pin_turns(turn)
        if self._rule is None:
            self._move(before)

    def grow_old(self) -> None:
        """Give every message the level that it has at the newest turn."""
        turn, strategies, trimmed, elided = self.turns[-1], self.strategies, 0, 0
        oldest = strategies.ageing.oldest(turn.step, self.budget.history, self.oldest)
        if strategies.trimming is not None:
            trimmed = strategies.trimming.trimmed_before(turn.step, self.trimmed_before)
        if strategies.eliding is not None:
            elided = strategies.eliding.elided(turn.pictures_so_far, self.elided)
        self.age(oldest, trimmed, elided)

    def view(self) -> View:
        """Return the next prompt: to play, or for words that are needed first, as its purpose says.

        `PromptOverflowError` if what every prompt shows does not fit; `StrategyError` if a custom strategy fails.
        """
        if self._rule is not None:
            return self._made(self._rule)
        if self._overflow is not None:
            raise PromptOverflowError(f"The pinned parts of the prompt take {self._overflow} tokens.")
        return self._asking or self._playing

    def answer(self, reply_text: str) -> Event:
        """Take the reply to a prompt for words; return what the record needs of it.

        Of a summary this is what is shown of it, and from where on turns stay. An answer of which nothing is left to
        show leaves the earlier summary as it is; the turns still leave.
        """
        if self._rule is not None:
            self._reply = {"role": "assistant", "content": reply_text}
            return {}
        form = self.strategies.summaries
        assert self._asking is not None
        assert form is not None
        self._asking = None
        self.summaries += 1
        was = self._summary
        if (text := form.cut(reply_text)) and (was is None or was.text != text):
            self._summary = form.show(text)
        self._playing = self._played(self._newest_turns())
        summary = self._summary
        shown = {"text": "", "tokens": 0} if summary is None else {"text": summary.text, "tokens": summary.tokens}
        is_cut = text != reply_text and bool(reply_text.strip())
        return {"covers": self._run.first, **shown, "cut": is_cut, "empty": not text}

    def close(self) -> None:
        """End a rule that may wait for a reply that never comes."""
        if self._making is not None:
            self._making.close()

    def _made(self, rule: Rule) -> View:
        making = self._making = self._making or rule()
        reply, self._reply = self._reply, None
        try:
            return making.send(reply)
        except StopIteration as end:
            self._making = None
            view = self._before = self._played(end.value)
        cap = self.budget.prompt_tokens
        if cap is not None and view.tokens > cap:
            always = self.always_tokens
            raise StrategyError(
                f"The choice takes {view.tokens - always} tokens, and there is room for {cap - always}."
            )
        return view

    # What is pinned.

    def _pin_turns(self, turn: Turn) -> None:
        """Pin the turn that shows the newest observation, and that of a strategy, where it fits beside the first."""
        strategies, last, cap = self.strategies, len(self.turns) - 1, self.budget.prompt_tokens
        most = math.inf if cap is None else cap - strategies.reserve
        shown = {last, last if self.newest is None else self.newest}
        pins = {number: self.turn_tokens(number) for number in shown}
        self.pinned = None
        if strategies.pinning is not None:
            pinned = strategies.pinning.pinned(turn)
            if pinned is not None and pinned not in shown:
                tokens = self.masked_tokens(pinned)
                if self.head_tokens + sum(pins.values()) + tokens <= most:
                    self.pinned, pins[pinned] = pinned, tokens
        self.pin(pins, most)

    def pin(self, pins: dict[int, int], most: float) -> None:
        """Pin turns, of which the newest is one, and then as many of the first turns as fit beside what they take."""
        last, left = len(self.turns) - 1, most - self.head_tokens - sum(pins.values())
        del pins[last]
        self._first_turns = 0
        for turn in range(min(self.strategies.first_turns, last)):
            tokens = 0 if turn in pins else self.turn_tokens(turn)
            if (left := left - tokens) < 0:
                break
            pins.setdefault(turn, tokens)
            self._first_turns += 1
        self._pins = sorted(pins)
        self._pins_before = [0, *accumulate(pins[turn] for turn in self._pins)]

    def prompt_tokens(self, first: int) -> int:
        """V: tokens of head, the run from `first` to the newest turn, and the pinned turns before it."""
        run = self.tokens(self.row(first, len(self.turns)))
        return self.head_tokens + run + self._pins_before[bisect_left(self._pins, first)]

    @property
    def always(self) -> set[int]:
        """The turns that every prompt shows."""
        return {*self._pins, len(self.turns) - 1} if self.turns else set()

    @property
    def always_tokens(self) -> int:
        """The tokens of the head and the turns that every prompt shows."""
        return self.prompt_tokens(len(self.turns) - 1) if self.turns else self.head_tokens

    # The built-in rule.

    def _move(self, newest_before: int | None) -> None:
        """Move the run on; where that makes turns leave, a summary may be asked for first."""
        run, summary = self._run, self._summary
        sizes = {"head": self.head_tokens, "summary": 0 if summary is None else summary.tokens}
        run.append(self.turns, self.prompt_tokens, self.places, oldest=self.oldest, pinned=self.pinned, **sizes)
        left, self._left = self._left, max(self._left, run.first)
        before = self._before = self._playing
        self._asking = self._overflow = None
        self._playing = self._played(self._newest_turns())
        if run.overflows:
            self._overflow = self.always_tokens + self.strategies.reserve
        elif self.strategies.summaries is not None and run.first > max(left, self._first_turns):
            self._asking = self._request(before, newest_before)

    def _newest_turns(self) -> Selection:
        first, firsts = self._run.first, self._first_turns
        texts = {}
        if self._summary is not None:  # it stands after the first turns
            before = (turn for turn in self._pins if firsts <= turn < first)
            texts[next(before, first)] = self._summary.form
        return self.run_from(first, texts)

    def run_from(self, first: int, texts: Mapping[int, Form] = MappingProxyType({})) -> Selection:
        """Return what shows the run from a turn on, the pinned turns before it, and texts before some turns."""
        pinned = self._pins[: bisect_left(self._pins, first)]
        masked = self.pinned if self.pinned in pinned else None
        rows = [range(turn, turn + 1) for turn in pinned] + [range(first, len(self.turns))]
        ages = self.oldest, self.trimmed_before, self.elided
        facts = {"anchors": self._first_turns}
        return Selection(rows, self.pieces(rows, texts), *ages, pinned=masked, facts=facts)

    def _request(self, before: View, newest: int | None) -> View:
        """Return the prompt for a summary: the one before without the turns that stay, and a question.

        `newest` is the turn that showed the newest observation then.
        """
        assert self.strategies.summaries is not None
        question = self.strategies.summaries.question
        assert question is not None
        chosen, first = before.selection, self._run.first
        *pinned, run = chosen.turns
        stay = len(self.row(first, run.stop))
        forms = before.forms[: len(before.forms) - stay]
        tokens = before.tokens - self._sum(before.forms[len(forms) :])
        chosen = replace(chosen, turns=[*pinned, range(run.start, first)])
        return replace(
            before,
            tokens=tokens + question.tokens(self.counter),
            shown_steps=self._reach(chosen, forms, newest),
            dropped_turns=run.stop - len(chosen),
            prefix_tokens=tokens - PRIMING,
            selection=chosen,
            forms=[*forms, question],
            purpose="summary",
            summaries=self.summaries,
        )

    def _reach(self, chosen: Selection, forms: Sequence[Form], newest: int | None) -> int:
        """How many observations messages show without a gap up to the newest.

        Observations of first turns before the run are not counted, except in the latest turn that shows the newest.
        """
        run = chosen.turns[-1]
        shown: Sequence[Form] = forms[len(forms) - len(self.row(run.start, run.stop)) :]
        if newest is not None and newest < run.start:
            shown = chosen.seen(self.turns[newest])
        first = next((form.step for form in shown if form.step is not None), None)
        return 0 if first is None else self.turns[run.stop - 1].step + 1 - first

    # Prompts.

    def _played(self, chosen: Selection) -> View:
        """Return the prompt to play that shows a selection."""
        shown = self.forms(chosen)
        own = [self.text(piece) for piece in chosen.pieces if isinstance(piece, Form)] if self._rule else []
        steps = {form.step for form in shown if form.step is not None} if self._rule else None
        return View(
            tools=self.tools,
            tokens=self.head_tokens + self._sum(shown),
            shown_steps=self._reach(chosen, shown, self.newest) if steps is None else len(steps),
            dropped_turns=len(self.turns) - len(chosen),
            prefix_tokens=self._prefix(shown),
            selection=chosen,
            forms=[*self.head, *shown],
            head=self.head,
            turns=self.turns,
            text_tokens=self._sum(own),
            summaries=self.summaries,
        )

    def tools_beside(self, forms: Iterable[Form]) -> tuple[ToolSpec, ...]:
        """Return the tools that are sent with a rule's question: none if there are no calls in it."""
        return self.tools if any(calls_of(form.message) for form in forms) else ()

    def question(self, chosen: Selection, facts: Mapping[str, Any]) -> View:
        """Return the prompt of a rule's question, which shows a selection."""
        forms = self.forms(chosen)
        tools = self.tools_beside(forms)
        tokens = PRIMING + self._sum(forms) + (self.tools_tokens if tools else 0)
        return View(
            tools=tools,
            tokens=tokens,
            shown_steps=0,
            dropped_turns=0,
            prefix_tokens=0,
            selection=chosen,
            forms=forms,
            turns=self.turns,
            purpose="compaction",
            facts=facts,
        )

    def _prefix(self, shown: Sequence[Form]) -> int:
        """The tokens at the beginning of a prompt that are the same in the one before: head, then messages."""
        before = self._before
        if before is None:
            return 0
        tokens, is_same = self._same_head(before)
        same = common_beginning(shown, before.forms[len(before.head) :], is_equal=self._by_words) if is_same else 0
        return tokens + self._sum(shown[:same])

    def _same_head(self, before: View) -> tuple[int, bool]:
        """The tokens of tools and messages that the head begins with as before, and whether all of it is the same."""
        if before.head is self.head:
            return self.head_tokens - PRIMING, True
        if before.tools != self.tools:
            return 0, False
        pairs = takewhile(lambda pair: pair[0].message == pair[1].message, zip(self.head, before.head, strict=False))
        return self.tools_tokens + self.counter.messages(form.message for form, _ in pairs), False
