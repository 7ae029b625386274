"""Spending: what the prompts and replies of an episode cost by the rule of its budget, while it is played.

The definition is that of `docs/context-cost.md`, in budget tokens, so that a replay finds the same. Sums are exact: no
rounding exceeds the cap.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction

from smartplay_tools.context.tokens import TokenCounter
from smartplay_tools.context.view import View
from smartplay_tools.costs.cached import Cache, Place, Prefixes, Unit, Units, hit_and_written, same_and_stable
from smartplay_tools.providers.cost_rules import CostRule
from smartplay_tools.types import Purpose
from smartplay_tools.types.messages import Message


class Spending:
    """What an episode may cost, and what it has cost so far."""

    def __init__(self, cap: float, rule: CostRule, counter: TokenCounter, marks: Sequence[Place]) -> None:
        """`marks` says where the player marks its prompts for a cache."""
        self.spent = Fraction()
        self._cap, self._rule = Fraction(repr(cap)), rule
        self._units, self._prefixes = Units(counter), Prefixes(by_purpose=rule.tool_choice)
        self._cache = Cache(self._prefixes, rule, marks)
        self._before: list[Unit] = []
        self._asked = Fraction()
        """What the latest prompt costs without its reply."""

    def take(self, view: View) -> float:
        """Take a prompt that is about to be sent; return the most tokens that its reply may have."""
        units = [self._units.tools(view.tools), *self._of(view)]
        same, stable = same_and_stable(units, self._before)
        self._before, rule = units, self._rule
        self._prefixes.add(units, same, view.purpose)
        found, stored = self._cache.look_up(-1, units, stable, view.tokens)
        hit, written = hit_and_written(found, stored, rule)
        fresh, read, write, price = rule.rates
        self._asked = (view.tokens - hit - written) * fresh + hit * read + written * write
        left = self._cap - self.spent - self._asked
        if left < 0:
            return -1
        return math.floor(left / price) if price else math.inf

    def charge(self, message: Message, tokens: int, purpose: Purpose) -> float:
        """Charge the latest prompt and its reply, as it is shown in later prompts; return what is spent."""
        self._prefixes.add_reply(self._units.of(message), purpose)
        self._cache.store_reply(-1)
        del self._prefixes.paths[:-1]
        self.spent += self._asked + tokens * self._rule.rates[-1]
        self._asked = Fraction()
        return float(self.spent)

    @property
    def with_prompt(self) -> float:
        """What is spent once the latest prompt is."""
        return float(self.spent + self._asked)

    def _of(self, view: View) -> Sequence[Unit]:
        """The units of messages; forms last as long as turns, and without tools each prompt has new ones."""
        of = self._units.__getitem__ if view.tools else lambda form: self._units.of(form.message)
        return [of(form) for form in view.forms]
