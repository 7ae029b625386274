"""The rules of prompt caches as data: what a provider stores, from which length on, and what reading and writing cost.

They are in the files of providers, each with the day and the page it was read on, because they change. A rule of your
own is a `CacheRule`.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import date
from fnmatch import fnmatchcase
from functools import cache, lru_cache
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from smartplay_tools.errors import UnknownNameError
from smartplay_tools.providers.prices import Price, provider_of, scaled
from smartplay_tools.providers.tables import merged

__all__ = ["CacheRule", "cache_rules", "rule_of"]

Rate = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Tokens = Annotated[int, Field(strict=True, ge=0)]


class CacheRule(BaseModel):
    """How one provider caches prompts. Tokens are the provider's where a record has its count, else budget tokens."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    title: str
    models: tuple[str, ...] = ()
    """Patterns of the models it holds for, each `PROVIDER:MODEL`."""
    minimum: Tokens = 0
    """The shortest prefix of which anything is cached."""
    block: Annotated[int, Field(strict=True, ge=1)] = 1
    """Hits are rounded down to a multiple of this."""
    read: Rate = 1
    """The price of a cached token, relative to an uncached one."""
    write: Rate | None = None
    """The price of a written token, relative to an uncached one; None if writing is not billed."""
    output: Rate = 0
    """The price of a reply's token, relative to an uncached one of the prompt, for costs without a price."""
    marks: Tokens | Literal["auto"] = "auto"
    """How many marks a request may set, of which the last ones count; "auto" stores every request whole."""
    lookback: Tokens | None = None
    """How many content blocks before a mark a stored prefix may end; None for no limit."""
    life: Rate | None = None
    """Seconds since a prefix was last used after which it is forgotten; None if that is not known."""
    replies: bool = False
    """Whether a reply stays in the cache behind its request."""
    tool_choice: bool = False
    """Whether requests with different tool choices have only tools and system messages in common."""
    read_on: date
    source: str
    note: str = ""

    def priced(self, price: Price | None = None) -> Price:
        """Return the price of a model with this rule's rates where it has none.

        Without a price, return one whose unit is an uncached token of the input.
        """
        return _priced(price, self.read, 1 if self.write is None else self.write, self.output)


@cache
def cache_rules() -> Mapping[str, CacheRule]:
    """Return the rules by name."""
    return {name: CacheRule(**{**table, "name": name}) for name, table in merged("caches").items()}


def rule_named(name: str, rules: Mapping[str, CacheRule]) -> CacheRule:
    """Return a rule by its name, or by the `PROVIDER:MODEL` it holds for; an unknown one is an `UnknownNameError`."""
    rule = rules.get(name) or _rule_for(name, rules)
    if rule is None:
        raise UnknownNameError("rule of a cache", name, rules)
    return rule


def rule_of(player: str, player_options: Mapping[str, Any], rules: Mapping[str, CacheRule]) -> CacheRule | None:
    """Return the rule of a player's model; None if there is no model, or no rule is known to hold for it."""
    return None if "base_url" in player_options else _rule_for(":".join(provider_of(player)), rules)


@lru_cache(64)
def _priced(price: Price | None, read: float, write: float, output: float) -> Price:
    if price is None:
        price = Price.per_million(1e6, output * 1e6, source="tokens")
    cached = scaled(price.input, read) if price.cached == price.input else price.cached
    written = price.write or scaled(price.input, write)
    return Price(price.input, price.output, cached, price.source, written, price.write_1h)


def _rule_for(model: str, rules: Mapping[str, CacheRule]) -> CacheRule | None:
    matching = (rule for rule in rules.values() if any(fnmatchcase(model, pattern) for pattern in rule.models))
    return next(matching, None)
