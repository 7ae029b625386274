"""Cost rules: what the tokens of an episode cost whose budget is in money, as one line of text.

    openai-5-5                              a rule of a cache in the package, in uncached tokens of the input
    openai:gpt-5.5                          a model, in US dollars: its price and the rule of its provider's cache
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

RATES = ("input", "read", "write", "output")
OPTIONS = (*RATES, "minimum", "block", "marks", "lookback", "replies", "tool_choice", "read_on")
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

    def cost(self, prompt: int, hit: int, written: int, reply: int = 0) -> Fraction:
        """Return what a request costs, exactly: rates are read as decimal numbers."""
        parts = zip((prompt - hit - written, hit, written, reply), self.exact, strict=True)
        return sum((tokens * rate for tokens, rate in parts), Fraction())

    @property
    def exact(self) -> Sequence[Fraction]:
        """The prices of a fresh, a read and a written token of a prompt, and of a reply's."""
        return _exact(self.input, self.read, self.write or 0, self.output)

    def __str__(self) -> str:
        given = ((name, getattr(self, name)) for name in OPTIONS)
        said = [(name, value) for name, value in given if name in ("input", "read") or value != _default(name)]
        return f"{self.name}:" + ",".join(f"{name}={_written(value)}" for name, value in said)


@lru_cache(1_000)
def cost_rule(line: str) -> CostRule:
    """Return the rule that a line names or spells out; an `InvalidArgumentError` says what a line can be."""
    parts = LINE.fullmatch(line)
    if parts is None:
        raise InvalidArgumentError(_remedy(f"{line!r} is no rule of costs"))
    name, options = parts.groups()
    if options is None:
        return _named(name)
    values: dict[str, Any] = {}
    for option in options.split(","):
        key, _, value = option.partition("=")
        if key not in OPTIONS or key in values:
            raise InvalidArgumentError(_remedy(f"{option!r} cannot stand in a rule of costs"))
        values[key] = _read(value)
    try:
        return CostRule(**{"name": name, "read": values.get("input", 1), **values})
    except ValidationError as error:
        first = error.errors()[0]
        raise InvalidArgumentError(f"{first['loc'][0]}={first['input']} in a rule of costs: {first['msg']}.") from None


def _named(name: str) -> CostRule:
    try:
        rule = rule_named(name, rules := cache_rules())
    except UnknownNameError:
        raise InvalidArgumentError(_remedy(f"There is no rule or model {name!r}")) from None
    own = {field: getattr(rule, field) for field in OPTIONS if field != "input"}
    if name in rules:
        return CostRule(name=name, **own)
    price = find_price(name, {})
    if price is None:
        raise InvalidArgumentError(_remedy(f"The price of {name} is not known here"))
    rates = rule.priced(price)
    of_each = {"input": rates.input, "read": rates.cached, "output": rates.output}
    if rule.write is not None:
        of_each["write"] = rates.write
    priced = CostRule(name=name, **own | {kind: float(f"{tiers[0][1] / 1e6:.12g}") for kind, tiers in of_each.items()})
    if any(len(tiers) > 1 for tiers in of_each.values()):
        raise InvalidArgumentError(
            f"The price of {name} changes with the length of a prompt; write it with the rates that hold for yours: "
            f"for short ones it is {str(priced)!r}."
        )
    return priced


def _remedy(fault: str) -> str:
    return (
        f"{fault}; name a rule ({', '.join(cache_rules())}) or a model as PROVIDER:MODEL, or write one as in "
        f"'ours:read=0.1,output=5', with any of {', '.join(OPTIONS)}."
    )


def _read(value: str) -> Any:
    try:
        return json.loads(value)
    except ValueError:
        return value


def _written(value: Any) -> str:
    return str(value) if isinstance(value, str | date) else json.dumps(value).removesuffix(".0")


def _default(name: str) -> Any:
    return CostRule.model_fields[name].default


@lru_cache(1_000)
def _exact(*rates: float) -> Sequence[Fraction]:
    return [Fraction(repr(rate)) for rate in rates]
