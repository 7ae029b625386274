"""The prices of models' tokens, from the tables of `genai-prices`, which work offline, or from the user.

A price is looked up once, when a run is created, and stored in its manifest, so that a run that is resumed next month
has the same prices. A model that is not in the tables has no price, and its cost is None instead of a guess.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any, Protocol, Self

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.providers.model_names import is_model

PROVIDERS = {"anthropic": "anthropic", "openai": "openai", "openai-responses": "openai"}
"""The provider that belongs to a player's name, unless the player has another server."""

Rates = tuple[tuple[int, float], ...]
"""US dollars per million tokens, by the prompt length from which they apply: ((0, 1.25), (200000, 2.5))."""

LATER = ("write", "write_1h")
"""Rates that older manifests do not have."""


class Counted(Protocol):
    """The tokens of a call, such as a `Usage`."""

    prompt: int
    cached: int | None
    written: int
    written_1h: int
    reply: int


@dataclass(frozen=True)
class Price:
    """The price of a model's tokens.

    Tokens that are read from a cache and those that are written to it are parts of the prompt with separate rates.
    """

    input: Rates
    output: Rates
    cached: Rates
    source: str
    write: Rates = ()
    """The rate of written tokens; empty for that of the input."""
    write_1h: Rates = ()
    """The rate of tokens that are written for an hour; empty for that of other written tokens."""

    def __post_init__(self) -> None:
        """Refuse rates that are none, such as bare numbers, which `per_million` takes."""
        for name in ("input", "output", "cached", *LATER):
            if not _are_rates(getattr(self, name), may_be_empty=name in LATER):
                raise InvalidArgumentError(
                    f"A price has an {name} rate that cannot be: rates are finite and not negative, and begin at 0 "
                    "tokens, as in ((0, 2.5),); Price.per_million(2.5, 10) makes a price of numbers."
                )

    @classmethod
    def per_million(
        cls,
        given: float,
        taken: float,
        cached: float | None = None,
        write: float | None = None,
        *,
        source: str = "given",
    ) -> Self:
        """Return a price in US dollars per million tokens of prompts, replies, cached and written parts.

        A rate that nothing can cost is an `InvalidArgumentError`.
        """
        read, written = given if cached is None else cached, () if write is None else ((0, write),)
        return cls(((0, given),), ((0, taken),), ((0, read),), source, written)

    @classmethod
    def parse(cls, text: str) -> Self:
        """Parse "INPUT,OUTPUT[,CACHED[,WRITTEN]]", in US dollars per million tokens."""
        try:
            return cls.per_million(*map(float, text.split(",")))
        except (TypeError, ValueError):  # another number of rates, or one that cannot be
            raise InvalidArgumentError(
                f"{text!r} is not a price; write INPUT,OUTPUT or INPUT,OUTPUT,CACHED,WRITTEN in USD per million."
            ) from None

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> Self:
        """Return the price that `to_json` wrote; `InvalidArgumentError` if it has a rate that nothing can cost."""
        names = ("input", "output", "cached", *(name for name in LATER if value.get(name)))
        rates = {name: tuple((start, rate) for start, rate in value[name]) for name in names}
        return cls(**rates, source=value["source"])

    def to_json(self) -> dict[str, Any]:
        """Return the price as plain data; a rate that it has not is left out."""
        return {name: value for name, value in asdict(self).items() if value or name not in LATER}

    def cost(self, usage: Counted) -> float:
        """Return the cost of a usage in US dollars."""
        return self._dollars(usage.prompt, usage.cached or 0, usage.written, usage.reply, usage.written_1h)

    def each(self, calls: Iterable[tuple[int, int, int, int]]) -> list[float]:
        """Return the cost of each call, given as tokens of prompt, cached part, written part and reply."""
        return [self._dollars(*call) for call in calls]

    def most(self, prompt: int, reply: int) -> float:
        """Return the most that a call can cost: nothing of its prompt is read from a cache, all of it is written."""
        given, _, write, write_1h, taken = self._rates_for(prompt)
        return (prompt * max(given, write, write_1h) + reply * taken) / 1_000_000

    def _dollars(self, prompt: int, cached: int, written: int, reply: int, written_1h: int = 0) -> float:
        given, read, write, write_1h, taken = self._rates_for(prompt)
        uncached, briefly = prompt - cached - written, written - written_1h  # one sum, in the order of earlier records
        dollars = uncached * given + cached * read + briefly * write + written_1h * write_1h + reply * taken
        return dollars / 1_000_000

    def _rates_for(self, prompt: int) -> tuple[float, ...]:
        """The rates for a prompt of this length, as in `_tiers`."""
        starts, tiers = self._tiers
        return tiers[bisect_right(starts, prompt) - 1]

    @cached_property
    def _tiers(self) -> tuple[list[int], list[tuple[float, ...]]]:
        """The lengths of prompts at which a rate changes, and the rates from there on.

        These are of uncached, cached and written tokens, of those written for an hour, and of the reply's.
        """
        write = self.write or self.input
        kinds = (self.input, self.cached, write, self.write_1h or write, self.output)
        starts = sorted({start for rates in kinds for start, _ in rates})
        return starts, [tuple(_rate(rates, start) for rates in kinds) for start in starts]


def find_price(player: str, player_options: Mapping[str, Any]) -> Price | None:
    """Return the price of a player's model; None if there is no model or no known price."""
    if not is_model(player) or "base_url" in player_options:
        return None
    try:
        import genai_prices
    except ImportError:
        return None
    provider, model = provider_of(player)
    try:
        priced = genai_prices.calc_price(genai_prices.Usage(), model, provider_id=provider or None)
    except LookupError:
        return None
    prices = priced.model_price
    given, taken = _rates(prices.input_mtok), _rates(prices.output_mtok)
    if given is None or taken is None:
        return None
    cached, write, write_1h = (
        _rates(getattr(prices, f"cache_{kind}_mtok", None)) for kind in ("read", "write", "write_1h")
    )
    source = f"genai-prices {genai_prices.__version__}"
    return Price(given, taken, cached or given, source, write or (), write_1h or ())


def provider_of(player: str) -> tuple[str, str]:
    """Return provider and model of a player's name; the provider is empty if the name does not say it."""
    family, _, model = player.partition(":")
    if family == "langchain":
        provider, _, model = model.rpartition(":")
        return provider, model
    return PROVIDERS.get(family, ""), model


def check_given(prices: Any) -> None:
    """Raise an `InvalidArgumentError` unless prices are those of players by name, or None."""
    if not isinstance(prices, Mapping | None):
        raise InvalidArgumentError(f"prices are a price for each player's name, not {type(prices).__name__}.")
    for player, price in (prices or {}).items():
        if not isinstance(price, Price):
            raise InvalidArgumentError(
                f"The price of {player} is a `Price`, such as Price.per_million(2.5, 10) in US dollars, not {price!r}."
            )


def check_known(unpriced: Iterable[str]) -> None:
    """Raise an `InvalidArgumentError` if players have no price, which a cap on cost requires."""
    if names := ", ".join(sorted(unpriced)):
        raise InvalidArgumentError(
            f"A cap on cost needs the price of {names}, which is not known here; give it with the run "
            "(--price PLAYER=INPUT,OUTPUT in US dollars a million tokens)."
        )


def scaled(rates: Rates, factor: float) -> Rates:
    """Return rates that are this many times as high."""
    return tuple((start, rate * factor) for start, rate in rates)


def _are_rates(rates: Any, *, may_be_empty: bool) -> bool:
    """Whether these are rates that something can cost."""
    if not isinstance(rates, tuple) or not all(isinstance(tier, tuple) and len(tier) == 2 for tier in rates):
        return False
    numbers = all(isinstance(number, int | float) for tier in rates for number in tier)
    if not rates or not numbers:
        return may_be_empty and not rates
    return bool(rates[0][0] == 0 and all(0 <= rate < math.inf for _, rate in rates))


def _rates(price: Any) -> Rates | None:
    if price is None:
        return None
    if hasattr(price, "tiers"):
        return ((0, float(price.base)), *((tier.start, float(tier.price)) for tier in price.tiers))
    return ((0, float(price)),)


def _rate(rates: Rates, prompt_tokens: int) -> float:
    return next(rate for start, rate in reversed(rates) if prompt_tokens >= start)
