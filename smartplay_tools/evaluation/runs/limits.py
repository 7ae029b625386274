"""Caps on the tokens and the cost of all episodes of a run together.

Before a call to a player its prompt and the longest allowed reply are reserved; a call that could exceed a cap is not
made, and its episode is paused. After the call the reservation is replaced by the actual use. With a cap on replies
(`Budget.reply_tokens`) a run's cap is therefore never exceeded, however many episodes run at once, unless a model
writes more than allowed; without one, only the replies that are already requested can exceed it.

Tokens are budget tokens, as everywhere, but for attempts at a reply that never came, of which there is the provider's
count alone; cost is computed from the provider's count of tokens, if it reports one. The most that a call can cost is
reserved: without a hit in the provider's cache, and with everything written to it.
"""

from __future__ import annotations

import math
import multiprocessing
import threading
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, Protocol, Self

from smartplay_tools.episode.episode import Episode
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.providers.prices import Price
from smartplay_tools.records.record import PAUSED
from smartplay_tools.types import Usage


@dataclass(frozen=True)
class Caps:
    """The caps of a run; None means no limit."""

    tokens: int | None = None
    """Budget tokens, prompts and replies together."""
    cost: float | None = None
    """US dollars."""

    def __post_init__(self) -> None:
        for name, cap in (("run_tokens", self.tokens), ("run_cost", self.cost)):
            if cap is not None and not cap > 0:
                raise InvalidArgumentError(f"{name} must be above 0, not {cap}; leave it out for no cap.")

    def __bool__(self) -> bool:
        return self.tokens is not None or self.cost is not None


class RunLimits(Protocol):
    """The shared limits of a run: its episodes reserve before a call and settle after it."""

    def reserve(self, tokens: int, cost: float) -> bool:
        """Reserve an amount, unless that would exceed a cap; return whether it was reserved."""
        ...

    def settle(self, reserved: tuple[int, float], spent: tuple[int, float]) -> None:
        """Replace what was reserved by what was spent."""
        ...


class SharedLimits:
    """Limits for the threads of a process or, with `processes`, for those of the worker processes they are given to."""

    def __init__(self, caps: Caps, spent: tuple[int, float] = (0, 0.0), *, processes: bool = False) -> None:
        self._caps = caps
        self._lock: AbstractContextManager[Any]
        self._used: Any
        if processes:
            context = multiprocessing.get_context("spawn")
            self._lock, self._used = context.Lock(), context.RawArray("d", list(spent))
        else:
            self._lock, self._used = threading.Lock(), list(spent)

    def reserve(self, tokens: int, cost: float) -> bool:
        """Reserve an amount as `RunLimits.reserve` does."""
        with self._lock:
            all_tokens, all_cost = self._used[0] + tokens, self._used[1] + cost
            if self._caps.tokens is not None and all_tokens > self._caps.tokens:
                return False
            if self._caps.cost is not None and all_cost > self._caps.cost:
                return False
            self._used[0], self._used[1] = all_tokens, all_cost
            return True

    def settle(self, reserved: tuple[int, float], spent: tuple[int, float]) -> None:
        """Replace what was reserved by what was spent."""
        with self._lock:
            self._used[0] += spent[0] - reserved[0]
            self._used[1] += spent[1] - reserved[1]


class Account:
    """The reservations and use of one episode: `reserve` before a call, `settle` after it and at the end."""

    def __init__(
        self, limits: RunLimits, episode: Episode, price: Price | None, question_price: Price | None = None
    ) -> None:
        """`price` is that of the player, `question_price` that of whom a compactor asks."""
        self._limits, self._episode = limits, episode
        self._price = self._own_price = price
        self._question_price = question_price
        self._reserved: tuple[int, float] = (0, 0.0)
        self._settled = episode.stats.tokens

    def reserve(self, prompt: int, longest: int, *, is_question: bool = False) -> None:
        """Reserve the tokens of a prompt and of its longest reply, or pause the episode."""
        self.settle()  # the reply to a prompt for a summary ends no turn
        self._price = self._question_price if is_question else self._own_price
        # If a provider has counted more tokens than we did, it is expected to do so in the next call, too.
        provider = self._settled.provider
        drift = 1.0 if provider is None else max(1.0, provider.prompt / max(1, self._settled.prompt))
        cost = 0.0 if self._price is None else self._price.most(math.ceil(prompt * drift), longest)
        if self._limits.reserve(prompt + longest, cost):
            self._reserved = (prompt + longest, cost)
        else:
            self._episode.end(PAUSED)

    def settle(self) -> None:
        """Settle everything that was charged since the last call."""
        before, now = self._settled, self._episode.stats.tokens
        tokens = now.prompt - before.prompt + now.reply - before.reply
        usage = Usage(prompt=now.prompt - before.prompt, reply=now.reply - before.reply)
        if now.provider is not None and now.provider != before.provider:
            earlier = before.provider or Usage(requests=0)
            # Cached tokens that nobody reported are None in both.
            more = {n: (getattr(now.provider, n) or 0) - (getattr(earlier, n) or 0) for n in Usage.model_fields}
            usage = usage.replaced_by(Usage(**more))
            tokens = tokens or usage.prompt + usage.reply  # of attempts at a reply that never came
        cost = 0.0 if self._price is None else self._price.cost(usage)
        self._limits.settle(self._reserved, (tokens, cost))
        self._reserved, self._settled = (0, 0.0), now

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.settle()
