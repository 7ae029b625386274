"""The prices of models' tokens, from the tables of `genai-prices`, which work offline, or from the user.

A price is looked up once, when a run is created, and stored in its manifest, so that a run that is resumed next month
has the same prices. A model that is not in the tables has no price, and its cost is None instead of a guess.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any, Self

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.types import Usage

PROVIDERS = {"anthropic": "anthropic", "openai": "openai", "openai-responses": "openai"}
"""The provider that belongs to a player's name, unless the player has another server."""

Rates = tuple[tuple[int, float], ...]
"""US dollars per million tokens, by the prompt length from which they apply: ((0, 1.25), (200000, 2.5))."""


@dataclass(frozen=True)
class Price:
    """The price of a model's tokens. Cached tokens are a part of the prompt that has its own rate."""

    input: Rates
    output: Rates
    cached: Rates
    source: str

    @classmethod
    def per_million(cls, given: float, taken: float, cached: float | None = None, source: str = "given") -> Self:
        """Return a price in US dollars per million tokens of prompts, replies and cached parts of prompts."""
        return cls(((0, given),), ((0, taken),), ((0, given if cached is None else cached),), source)

    @classmethod
    def parse(cls, text: str) -> Self:
        """Parse "INPUT,OUTPUT" or "INPUT,OUTPUT,CACHED", in US dollars per million tokens."""
        try:
            numbers = [float(part) for part in text.split(",")]
        except ValueError:
            numbers = []
        if len(numbers) not in (2, 3) or not all(0 <= number < math.inf for number in numbers):
            raise InvalidArgumentError(
                f"{text!r} is not a price; write INPUT,OUTPUT or INPUT,OUTPUT,CACHED in USD per million."
            )
        given, taken, cached = [*numbers, numbers[0]][:3]
        return cls.per_million(given, taken, cached)

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> Self:
        """Return the price that `to_json` wrote; `InvalidArgumentError` if it has a rate that nothing can cost."""
        rates = {name: tuple((start, rate) for start, rate in value[name]) for name in ("input", "output", "cached")}
        for name, tiers in rates.items():
            if not tiers or tiers[0][0] != 0 or not all(0 <= rate < math.inf for _, rate in tiers):
                raise InvalidArgumentError(
                    f"A price has an {name} rate that cannot be: rates are finite, not negative, and begin at 0 tokens."
                )
        return cls(**rates, source=value["source"])

    def to_json(self) -> dict[str, Any]:
        """Return the price as plain data."""
        return asdict(self)

    def cost(self, usage: Usage) -> float:
        """Return the cost of a usage in US dollars."""
        fresh = usage.prompt - usage.cached
        dollars = (
            fresh * _rate(self.input, usage.prompt)
            + usage.cached * _rate(self.cached, usage.prompt)
            + usage.reply * _rate(self.output, usage.prompt)
        )
        return dollars / 1_000_000


def find_price(player: str, player_options: Mapping[str, Any]) -> Price | None:
    """Return the price of a player's model; None if there is no model or no known price."""
    from smartplay_tools.players.registry import is_model

    if not is_model(player) or "base_url" in player_options:
        return None
    family, _, model = player.partition(":")
    try:
        import genai_prices
    except ImportError:
        return None
    provider: str | None = PROVIDERS.get(family)
    if family == "langchain":
        provider, _, model = model.rpartition(":")
    try:
        found = genai_prices.calc_price(genai_prices.Usage(), model, provider_id=provider or None)
    except LookupError:
        return None
    prices = found.model_price
    given, taken = _rates(prices.input_mtok), _rates(prices.output_mtok)
    if given is None or taken is None:
        return None
    cached = _rates(getattr(prices, "cache_read_mtok", None)) or given
    return Price(given, taken, cached, f"genai-prices {genai_prices.__version__}")


def check_known(unpriced: Iterable[str]) -> None:
    """Raise an `InvalidArgumentError` if players have no price, which a cap on cost requires."""
    if names := ", ".join(sorted(unpriced)):
        raise InvalidArgumentError(
            f"A cap on cost needs the price of {names}, which is not known here; give it with the run "
            "(--price PLAYER=INPUT,OUTPUT in US dollars a million tokens)."
        )


def _rates(price: Any) -> Rates | None:
    if price is None:
        return None
    if hasattr(price, "tiers"):
        return ((0, float(price.base)), *((tier.start, float(tier.price)) for tier in price.tiers))
    return ((0, float(price)),)


def _rate(rates: Rates, prompt_tokens: int) -> float:
    return next(rate for start, rate in reversed(rates) if prompt_tokens >= start)
