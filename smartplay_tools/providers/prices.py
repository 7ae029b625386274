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
from itertools import repeat
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
                    f"A price has an {name} rate that cannot be: rates are finite, not negative, and begin at 0 "
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
        if not all(0 <= rate < math.inf for rate in (given, taken, cached or 0, write or 0)):
            raise InvalidArgumentError("The rates of a price are finite and not negative, in USD per million tokens.")
        read, written = given if cached is None else cached, () if write is None else ((0, write),)
        return cls(((0, given),), ((0, taken),), ((0, read),), source, written)

    @classmethod
    def parse(cls, text: str) -> Self:
        """Parse "INPUT,OUTPUT[,CACHED[,WRITTEN]]", in US dollars per million tokens."""
        try:
            numbers = [float(part) for part in text.split(",")]
        except ValueError:
            numbers = []
        if len(numbers) not in (2, 3, 4) or not all(0 <= number < math.inf for number in numbers):
            raise InvalidArgumentError(
                f"{text!r} is not a price; write INPUT,OUTPUT or INPUT,OUTPUT,CACHED,WRITTEN in USD per million."
            )
        given, taken, *parts = numbers
        return cls.per_million(given, taken, parts[0] if parts else None, parts[1] if len(parts) > 1 else None)

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
        prompt, write, cached = usage.prompt, self.write or self.input, usage.cached or 0
        dollars = (
            (prompt - cached - usage.written) * _rate(self.input, prompt)
            + cached * _rate(self.cached, prompt)
            + (usage.written - usage.written_1h) * _rate(write, prompt)
            + usage.written_1h * _rate(self.write_1h or write, prompt)
            + usage.reply * _rate(self.output, prompt)
        )
        return dollars / 1_000_000

    def most(self, prompt: int, reply: int) -> float:
        """Return the most that a call can cost: nothing of its prompt is read from a cache, all of it is written."""
        rate = max(_rate(rates, prompt) for rates in (self.input, self.write, self.write_1h) if rates)
        return (prompt * rate + reply * _rate(self.output, prompt)) / 1_000_000

    @cached_property
    def _tiers(self) -> tuple[list[int], list[tuple[float, float, float, float]]]:
        """The lengths of prompts at which a rate changes, and the four rates from there on."""
        kinds = (self.input, self.cached, self.write or self.input, self.output)
        starts = sorted({start for rates in kinds for start, _ in rates})
        given, read, write, taken = ([_rate(rates, start) for start in starts] for rates in kinds)
        return starts, [*zip(given, read, write, taken, strict=True)]

    def each(self, calls: Iterable[tuple[int, int, int, int]]) -> list[float]:
        """Return the cost of each call, given as tokens of prompt, cached part, written part and reply."""
        starts, tiers = self._tiers
        rated: Iterable[tuple[tuple[int, int, int, int], tuple[float, float, float, float]]]
        if len(tiers) == 1:
            rated = zip(calls, repeat(tiers[0]))
        else:
            rated = ((call, tiers[bisect_right(starts, call[0]) - 1]) for call in calls)
        return [
            ((prompt - cached - written) * given + cached * read + written * write + reply * taken) / 1_000_000
            for (prompt, cached, written, reply), (given, read, write, taken) in rated
        ]


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
