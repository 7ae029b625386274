"""Tariffs: the rule of a cache with the price of a model, under which the records of a run are charged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from smartplay_tools.costs.cached import PLACES, Place
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.costs.charges import Charge, charge
from smartplay_tools.providers.caches import CacheRule, cache_rules, rule_named
from smartplay_tools.providers.prices import Price, find_price
from smartplay_tools.records.damage import damage_named, warn_damaged
from smartplay_tools.records.record import Record
from smartplay_tools.records.requests import requests_of


@dataclass(frozen=True)
class Tariff:
    """A rule, a price, and where the player sets marks. Without a price, costs are in uncached tokens of the input."""

    label: str
    rule: CacheRule
    price: Price | None = None
    marks: Sequence[Place] = PLACES


def tariffs_of(
    names: Sequence[str],
    *,
    price: Price | None = None,
    marks: Sequence[Place] = PLACES,
) -> list[Tariff]:
    """Return the tariffs that a user names: rules, or models as `PROVIDER:MODEL` with their price in the tables.

    Without names they are all rules. `price` is one for all tariffs.
    """
    rules = cache_rules()
    return [
        Tariff(name, rule_named(name, rules), price or (None if name in rules else find_price(name, {})), marks)
        for name in names or rules
    ]


def charge_records(records: Mapping[str, Path], tariffs: Sequence[Tariff]) -> dict[str, Sequence[Charge] | None]:
    """Return the cost of each record by its key, one for each tariff; None for a record without prompts, or damaged.

    One whose tokenizer does not ship with this package, and was not named in this process, is left out in the same way.
    """
    charged: dict[str, Sequence[Charge] | None] = dict.fromkeys(records)
    for key, path in records.items():
        try:
            with damage_named(path):
                charged[key] = _charged_record(Record.read(path), tariffs)
        except InvalidArgumentError as error:  # it is damaged, or nobody has named its tokenizer
            warn_damaged(error)
    return charged


def _charged_record(record: Record, tariffs: Sequence[Tariff]) -> Sequence[Charge] | None:
    if not record.heads or (record.messages and not any("prompt" in event for event in record.usages)):
        return None
    log = requests_of(record)
    return [charge(log, each.rule, marks=each.marks, price=each.price) for each in tariffs]
