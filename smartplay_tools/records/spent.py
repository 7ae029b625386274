"""The tokens and cost that episodes have used, added up: as a sum (`Spent`), and counted while a record grows."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from operator import add
from typing import Any

from smartplay_tools.providers.prices import Price
from smartplay_tools.transcript.events import Event, purpose_of
from smartplay_tools.transcript.hashing import canonical_json
from smartplay_tools.types import Usage
from smartplay_tools.types.sums import added

DIGITS = 12
"""Decimals of a difference in US dollars; further ones are rounding errors."""


@dataclass(frozen=True)
class Spent:
    """The tokens and cost that attempts have used."""

    replies: int = 0
    """Replies that have arrived."""
    prompt_tokens: int = 0
    """Budget tokens of prompts; of attempts at a reply that never came, the provider's tokens."""
    reply_tokens: int = 0
    """The same of replies."""
    cost: float | None = 0.0
    """US dollars; None if a provider has counted tokens whose price is not known."""
    unknown_calls: int = 0
    """Calls whose process died before the reply."""
    unknown_tokens: int = 0
    """The most tokens that those calls can have taken, as far as their replies had a cap."""
    unknown_cost: float = 0.0
    """The US dollars for these tokens, if a price is known."""

    @property
    def tokens(self) -> int:
        """The sum of budget tokens, as the caps of a run count them."""
        return self.prompt_tokens + self.reply_tokens

    def __add__(self, other: Spent) -> Spent:
        return self._with(other, add)

    def __sub__(self, other: Spent) -> Spent:
        return self._with(other, lambda mine, theirs: round(mine - theirs, DIGITS))

    def _with(self, other: Spent, combine: Callable[[Any, Any], Any]) -> Spent:
        """The sums of both; a figure that one of them does not know is unknown in the sum."""
        pairs = {name: (mine, vars(other)[name]) for name, mine in vars(self).items()}
        both: dict[str, Any] = {name: None if None in pair else combine(*pair) for name, pair in pairs.items()}
        return Spent(**both)


@dataclass
class _Sum:
    """What the usages of a record add up to so far."""

    replies: int = 0
    prompt_tokens: int = 0
    peak_prompt_tokens: int = 0
    """The tokens of the largest prompt to play; questions can have a separate cap."""
    reply_tokens: int = 0
    costs: list[float] = field(default_factory=list)
    """The cost of each, if there is a price."""
    is_unpriced: bool = False
    """Whether a provider has counted tokens whose price is not known."""

    def add(self, usage: Mapping[str, Any], price: Price | None) -> None:
        """Add a `usage` event."""
        self.replies += "reply" in usage
        reported = Usage.reported(usage)
        ours = Usage(prompt=usage.get("prompt", 0), reply=usage.get("reply", 0))
        # Of attempts at a reply that never came there is no other count than the provider's.
        counted = ours if "reply" in usage or reported is None else reported
        self.prompt_tokens += counted.prompt
        if purpose_of(usage) == "play":
            self.peak_prompt_tokens = max(self.peak_prompt_tokens, ours.prompt)
        self.reply_tokens += counted.reply
        if price is not None:
            self.costs.append(price.cost(ours.replaced_by(reported)))
        elif reported is not None:
            self.is_unpriced = True

    def spent(self) -> Spent:
        """Return it as a `Spent`."""
        cost = None if self.is_unpriced else float(added(self.costs))
        return Spent(self.replies, self.prompt_tokens, self.reply_tokens, cost)


class _Play:
    """The prompts and replies of a record so far."""

    def __init__(self) -> None:
        self.limited: int | None = None
        """Prompts that lacked something of the past."""
        self._digest = hashlib.sha256()

    def add(self, event: Event) -> None:
        """Add a `view`, or the message of a reply."""
        if event["event"] == "view":
            self.limited = (self.limited or 0) + bool(event["dropped_turns"] or event.get("masked"))
            self._digest.update(event["sha256"].encode())
        elif event.get("by", "player") == "player":
            self._digest.update(canonical_json(event.get("message")))

    @property
    def sha256(self) -> str | None:
        """A hash of all of them, if there are prompts."""
        return None if self.limited is None else self._digest.hexdigest()[:32]


class RecordCounts:
    """What the events of a record add up to."""

    def __init__(self, prices: Mapping[str, Price]) -> None:
        self._prices = prices
        self._price: Price | None = None
        self._question_price: Price | None = None
        """The price of the player that answers a compactor's questions."""
        self.whole, self.own, self.questions = _Sum(), _Sum(), _Sum()
        self.play = _Play()
        self.steps = 0
        self.declares = False
        """Whether the game has declared what an action needs, or which actions break its rules."""
        self._since_prompt: list[Event] = []

    def take(self, event: Event) -> None:
        """Count an event."""
        match event["event"]:
            case "start":
                from smartplay_tools.players.player_registry import second_name  # only a record's start needs players

                config = event["config"]
                self._price = self._prices.get(config.get("player") or "")
                second = second_name(config.get("player_options", {}))
                self._question_price = self._price if second is None else self._prices.get(second)
            case "usage":
                self._add(event)
            case "sent":
                self._add({"prompt": event["tokens"], "reply": event["reply"], "provider": None})
            case "call":
                data = event["data"]
                self.steps = data.get("step", self.steps)  # a call that was not played has none
                self.declares = self.declares or "needs" in data or "breaks" in data
            case "view":
                self._since_prompt = [event]
                self.play.add(event)
            case "message" | "summary" | "question":
                self._since_prompt.append(event)
                self.play.add(event)
            case "resume":  # a prompt without a reply is sent once more, and so is a further call
                self.own = _Sum()

    def _add(self, usage: Event) -> None:
        self.whole.add(usage, self._price_of(usage))
        self.own.add(usage, self._price_of(usage))
        if purpose_of(usage) == "compaction":
            self.questions.add(usage, self._question_price)

    def _price_of(self, event: Event) -> Price | None:
        """The price of the player that is asked by the prompt of a `view` or `usage` event."""
        return self._question_price if purpose_of(event) == "compaction" else self._price

    def open_call(self) -> Spent:
        """The call that was made with the latest prompt, unless its reply follows."""
        waiting: Event | None = None
        for event in self._since_prompt:
            if event["event"] == "view":
                waiting = event
            elif event.get("by", "player") == "player":  # a summary is a reply of the player, too
                return Spent()
        if waiting is None:
            return Spent()
        prompt, reply, price = waiting["tokens"], waiting["max_tokens"] or 0, self._price_of(waiting)
        cost = 0.0 if price is None else price.most(prompt, reply)
        return Spent(unknown_calls=1, unknown_tokens=prompt + reply, unknown_cost=cost)
