"""Which turns a prompt shows, and how: docs/budgets.md and docs/strategies.md, by plain sums over all turns.

After every turn the boundaries, the pins and the first turn of the run are decided anew; nothing here is fast.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

from .choosing import AtRandom, wrongly_given
from .counting import Counting
from .turns import Turn


@dataclass(frozen=True)
class View:
    """What a prompt shows: the turns in their order, with the boundary of each (None: all masked)."""

    turns: tuple[tuple[int, int | None], ...] = ()
    anchors: int = 0
    """How many of these stand in front of the summary."""
    words: int = 0
    pictures: int = 0
    """How many of the conversation's first pictures are left out."""
    counting: frozenset[int] = frozenset()
    """The turns whose observations count as shown: the run, and the latest turn that shows the newest one."""
    texts: tuple[tuple[int, str], ...] = ()
    """The words of a strategy of one's own, each before a turn."""


@dataclass
class Window:
    """What is decided after each turn."""

    budget: Any
    n: Counting
    question: int
    """Tokens of the question for a summary; 0 without summaries."""
    longest_summary: int
    first: int = 0
    left: int = 0
    """The latest turn that any prompt so far began with: of earlier ones no summary is asked for again."""
    oldest: int = 0
    words: int = 0
    pictures: int = 0
    ends: bool = False
    """Whether the pinned turns do not fit."""
    fails: bool = False
    """Whether a strategy of one's own chose what it must not."""
    leaves: int | None = None
    """The first turn that stays, where a summary is owed."""
    view: View = field(default_factory=View)
    wrong: str = ""
    """What a strategy of one's own was given that is not so."""

    def decide(self, turns: Sequence[Turn], head: int, summary: int) -> None:
        """Decide after a turn; `head` and `summary` are tokens of head, tools and priming, and of the last summary."""
        budget, cap = self.budget, self.budget.prompt_tokens
        newest = len(turns) - 1
        shows = [item.shows for turn in turns for item in turn.items if item.shows is not None]
        t = max(shows, default=0)
        shown = sum(item.picture is not None for turn in turns for item in turn.items)
        self.oldest = self._boundary(t, budget.history)
        self.words = t + 1 if budget.own_words == "never" else self._boundary(t, budget.own_words)
        self.pictures = self._boundary(shown - 1, budget.newest_pictures and budget.newest_pictures - 1)
        o = max((i for i, turn in enumerate(turns) if any(item.shows == t for item in turn.items)), default=newest)
        notes = [i for i, turn in enumerate(turns) if turn.notes is not None]
        q = notes[-1] if notes and turns[notes[-1]].notes else None

        by_age = [self.n.messages(turn.seen(self.oldest, self.words, self.pictures)) for turn in turns]
        before = list(by_age)
        if q is not None and q != o:
            before[q] = self.n.messages(turns[q].seen(None, self.words, self.pictures))
        reserve = self.question + self.longest_summary

        pins = {o, newest}
        room = math.inf if cap is None else cap - head - reserve
        if q is not None and sum(before[i] if i == q != newest else by_age[i] for i in {*pins, q}) <= room:
            pins.add(q)
        if budget.strategy is not None:
            given = room if cap is None else room - sum(before[i] if i != newest else by_age[i] for i in pins)
            facts = {"step": t, "oldest": self.oldest, "words": self.words, "pictures": self.pictures, "pins": pins}
            self._ask(turns, {**facts, "room": None if cap is None else given}, q if q not in (o, newest) else None)
            return
        anchors = 0
        while anchors < min(budget.first_turns or 0, len(turns)):
            together = pins | {*range(anchors + 1)}
            if sum(by_age[i] if i == newest else before[i] for i in together) > room:
                break
            anchors += 1
        pins |= {*range(anchors)}

        def cost(i: int) -> int:
            return head + sum(by_age[i:]) + sum(before[pin] for pin in pins if pin < i)

        def too_old(i: int) -> bool:
            if budget.history is None or budget.beyond_history == "mask":
                return False
            begin = next((k + 1 for k in range(i, -1, -1) if turns[k].plays), 0)
            end = next((k for k in range(i, len(turns)) if turns[k].plays), len(turns))
            follow = self._boundary(end - begin - 1, budget.history)
            stalled = budget.stalled_turns is not None and not turns[i].plays and i - begin < follow
            return turns[i].step < self.oldest or stalled

        def fits(i: int) -> bool:
            return cap is None or cost(i) + reserve <= cap

        if not fits(newest):
            self.leaves, self.ends, self.first, self.left = None, True, newest, newest
            return
        moved = newest
        while moved > 0 and not too_old(moved - 1) and fits(moved - 1):
            moved -= 1
        if cap is not None and moved > 0 and not too_old(moved - 1):
            sizes = [self.n.messages(turn.seen(0, 0)) for turn in turns]
            block = max(1, math.floor(Fraction(str(budget.slack)) * (cap - head - reserve)))
            while moved < newest and sum(sizes[:moved]) // block == sum(sizes[: moved - 1]) // block:
                moved += 1
        self.leaves = moved if budget.summary_tokens is not None and moved > max(anchors, self.left) else None
        self.first, self.left = moved, max(moved, self.left)
        self.ends = False
        run = {*range(self.first, len(turns))}
        shown = tuple((i, None if i == q and i not in run and i != o else self.oldest) for i in sorted(run | pins))
        in_front = sum(i < anchors and i not in run for i, _ in shown)
        self.view = View(shown, in_front, self.words, self.pictures, frozenset(run | {o}))

    def _ask(self, turns: Sequence[Turn], facts: dict[str, Any], hidden: int | None) -> None:
        """Let a strategy of one's own choose, beside the pins; `hidden` is the turn with the notes."""
        self.ends = facts["room"] is not None and facts["room"] < 0
        if self.ends:
            return
        asked = AtRandom.latest[len(turns)]
        self.wrong = wrongly_given(asked, self.n, turns, facts)
        self.fails = asked.is_wrong
        if self.fails:
            return
        masked = {*asked.choice.masked, hidden}
        shown = sorted({*asked.choice.turns, *facts["pins"]})
        each = tuple((i, None if i in masked else self.oldest) for i in shown)
        texts = tuple(sorted(asked.choice.texts.items()))
        self.view = View(each, 0, self.words, self.pictures, frozenset(shown), texts)

    def _boundary(self, n: int, most: int | None) -> int:
        """Return the smallest multiple of a block that is at most `most` before n."""
        if most is None or n <= most:
            return 0
        block = math.floor(Fraction(str(self.budget.slack)) * most) + 1
        return block * -((most - n) // block)
