"""Cost rules: what the tokens of an episode cost whose budget is in money, as one line of text.

    openai-5-5                              a rule of a cache in the package, in uncached tokens of the input
    anthropic:claude-opus-5                 a model, in US dollars: its price and the rule of its provider's cache
    ours:read=0.25,output=5,minimum=1024    numbers of your own, in whatever the budget is in

The first two are written out as the third when a budget is made, so that a record has the numbers it was played with.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from datetime import date
from fractions import Fraction
from functools import lru_cache
from typing import Any

from pydantic import ValidationError

from smartplay_tools.errors import InvalidArgumentError, UnknownNameError
from smartplay_tools.providers.caches import CacheRule, Rate, cache_rules, rule_named
from smartplay_tools.providers.prices import find_price

__all__ = ["CostRule", "cost_rule"]

OPTIONS = (
    *("input", "read", "write", "output", "minimum", "block", "marks", "lookback", "replies", "tool_choice", "read_on"),
)
"""What a line can say. A cache's `life` is not among them: an episode does not depend on the clock."""

LINE = re.compile(r"(?P<name>[^=,]+?)(?::(?P<options>\w+=.*))?")

NO_CACHE = "none:input=1,read=1,output=5,marks=0"
"""The rule of a budget that names none."""


class CostRule(CacheRule):
    """What a token costs, and the rule of the cache. `read`, `write` and `output` are of a token, as `input` is."""

    input: Rate = 1
    """The price of a token of a prompt that is neither read from the cache nor written to it."""
    title: str = ""
    source: str = ""
    read_on: date = date.min
    """The day on which the numbers were read; `date.min` if it is not said."""

    @property
    def rates(self) -> Sequence[Fraction]:
        """The exact prices of a fresh, a read and a written token of a prompt, and of a reply's."""
        return _exact(self.input, self.read, self.write or 0, self.output)

    def __str__(self) -> str:
        given = self.model_dump(include={*OPTIONS}, exclude_defaults=True) | {"input": self.input, "read": self.read}
        said = ((name, given[name]) for name in OPTIONS if name in given)
        return f"{self.name}:" + ",".join(f"{name}={_written(value)}" for name, value in said)


@lru_cache(1_000)
def cost_rule(line: str) -> CostRule:
    """Return the rule that a line names or spells out; an `InvalidArgumentError` says what a line can be."""
    parts = LINE.fullmatch(line)
    if parts is None or parts["options"] is None:
        return _named(line)
    pairs = [option.partition("=")[::2] for option in parts["options"].split(",")]
    read = {name: _read(value) for name, value in pairs}
    if read.keys() - set(OPTIONS) or len(read) < len(pairs):
        raise InvalidArgumentError(f"{line!r} is no rule of costs; it can have {', '.join(OPTIONS)}, each once.")
    try:
        return CostRule(**{"name": parts["name"], "read": read.get("input", 1), **read})
    except ValidationError as error:
        first = error.errors()[0]
        raise InvalidArgumentError(f"{first['loc'][0]}={first['input']} in a rule of costs: {first['msg']}.") from None


def _named(name: str) -> CostRule:
    rules, price = cache_rules(), find_price(name, {})
    try:
        rule = rule_named(name, rules)
    except UnknownNameError as error:
        example = "write PROVIDER:MODEL, or numbers as in 'ours:read=0.1,output=5'"
        raise InvalidArgumentError(f"{str(error).removesuffix('.')}; or {example}.") from None
    own = {field: getattr(rule, field) for field in OPTIONS if field != "input"}
    if name in rules:
        return CostRule(name=name, **own)
    if price is None:
        raise InvalidArgumentError(f"The price of {name} is not known here; write {CostRule(name=name, **own)} in USD.")
    rates = rule.priced(price)
    tiers = {"input": rates.input, "read": rates.cached, "output": rates.output}
    tiers |= {} if rule.write is None else {"write": rates.write}
    priced = CostRule(
        name=name, **own | {kind: float(f"{of_kind[0][1] / 1e6:.12g}") for kind, of_kind in tiers.items()}
    )
    if any(len(of_kind) > 1 for of_kind in tiers.values()):
        raise InvalidArgumentError(
            f"The price of {name} changes with the length of a prompt; write it with the rates that hold for yours: "
            f"for short ones it is {str(priced)!r}."
        )
    return priced


def _read(value: str) -> Any:
    try:
        return json.loads(value)
    except (ValueError, RecursionError):
        return value


def _written(value: Any) -> str:
    return str(value) if isinstance(value, str | date) else json.dumps(value).removesuffix(".0")


@lru_cache(1_000)
def _exact(*rates: float) -> Sequence[Fraction]:
    return [Fraction(repr(rate)) for rate in rates]
