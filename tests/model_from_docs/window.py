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
    """The state that is carried from turn to turn: the first turn of the run and the boundaries that move in blocks."""

    budget: Any
    n: Counting
    question: int
    """Tokens of the question for a summary; 0 without summaries."""
    longest_summary: int
    first: int = 0
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
        slack, newest = Fraction(str(budget.slack)), len(turns) - 1
        shows = [item.shows for turn in turns for item in turn.items if item.shows is not None]
        t = max(shows, default=0)
        self.oldest = self._boundary(self.oldest, t, budget.history, budget.beyond_history == "mask")
        self.words = self._boundary(self.words, t, budget.own_words, True)
        self.pictures = self._left_out(sum(item.picture is not None for turn in turns for item in turn.items))
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

        def too_old(i: int, share: Fraction) -> bool:
            if budget.history is None or budget.beyond_history == "mask":
                return False
            most = math.ceil(share * budget.history)
            following = next((k for k, turn in enumerate(turns[i + 1 :]) if turn.plays), newest - i)
            stalled = budget.stalled_turns is not None and not turns[i].plays and following > most
            return turns[i].step < t - most or stalled

        def fill(share: Fraction) -> int:
            i, base = newest, cost(newest)
            while i > 0 and not too_old(i - 1, share):
                if cap is not None and cost(i - 1) - base > share * (cap - reserve - base):
                    break
                i -= 1
            return i

        self.leaves = None
        stays = (
            slack > 0
            and (cap is None or cost(self.first) + self.question + summary <= cap)
            and not any(too_old(i, Fraction(1)) for i in range(self.first, newest))
        )
        if not stays:
            if cap is not None and cost(newest) + reserve > cap:
                self.ends = True
                return
            moved = fill(1 - slack)
            if budget.summary_tokens is not None and moved > anchors:
                self.leaves = moved
            self.first = moved
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

    def _left_out(self, m: int) -> int:
        """Return how many of m pictures are left out."""
        k, slack = self.budget.newest_pictures, Fraction(str(self.budget.slack))
        if k is None:
            return 0
        if not slack:
            return max(0, m - int(k))
        return self.pictures if m - self.pictures <= k else m - 1 - math.ceil((1 - slack) * (k - 1))

    def _boundary(self, now: int, t: int, most: int | None, in_blocks: bool) -> int:
        if most is None:
            return 0
        slack = Fraction(str(self.budget.slack))
        if not slack or not in_blocks:
            return max(0, t - most)
        return now if t - now <= most else t - math.ceil((1 - slack) * most)
