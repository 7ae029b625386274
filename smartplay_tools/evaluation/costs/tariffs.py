"""Tariffs: the rule of a cache with the price of a model, under which the records of a run are charged."""

from __future__ import annotations

import gc
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

from smartplay_tools.context.tokens.tokenizers import named_tokenizers, open_tokenizers
from smartplay_tools.costs.cached import PLACES, Place, marks_of
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.costs.charges import Charge, charge
from smartplay_tools.evaluation.processes import parallel_map, worth
from smartplay_tools.providers.caches import CacheRule, cache_rules, rule_named, rule_of
from smartplay_tools.providers.prices import Price, find_price
from smartplay_tools.records.damage import damage_named, warn_damaged
from smartplay_tools.records.record import Record
from smartplay_tools.records.requests import requests_of

WORTH_A_PROCESS = 6_000_000
"""Bytes of records for which another process is started: fewer are charged before it has imported what it needs."""

MANY_OBJECTS = 50_000
"""New objects after which the garbage collector looks for cycles: those of some dozens of records."""


@dataclass(frozen=True)
class Tariff:
    """A rule, a price, and where the player sets marks. Without a price, costs are in uncached tokens of the input."""

    label: str
    rule: CacheRule
    price: Price | None = None
    marks: Sequence[Place] = PLACES


class Charged(NamedTuple):
    """What an episode costs under tariffs."""

    charges: Sequence[Charge]
    own: Charge | None
    """Under the rule and price of its player's model, if both are known."""


def tariffs_of(
    names: Sequence[str],
    *,
    caches: Path | None = None,
    price: Price | None = None,
    marks: Sequence[Place] = PLACES,
) -> list[Tariff]:
    """Return the tariffs that a user names: rules, or models as `PROVIDER:MODEL` with their price in the tables.

    Without names they are all rules. `caches` is a file with further rules; `price` is one for all tariffs.
    """
    rules = cache_rules(caches)
    return [
        Tariff(name, rule_named(name, rules), price or (None if name in rules else find_price(name, {})), marks)
        for name in names or rules
    ]


def charge_records(
    records: Mapping[str, Path],
    tariffs: Sequence[Tariff],
    prices: Mapping[str, Price],
    *,
    caches: Path | None = None,
    processes: int = 1,
) -> dict[str, Charged | None]:
    """Return the cost of each record by its key; None for a record without prompts, or one that is damaged.

    One whose tokenizer does not ship with this package, and was not named in this process, is left out in the same way.

    `prices` are those of the run by player.
    """
    named = named_tokenizers()
    work = partial(_charge_all, tariffs=tariffs, prices=prices, rules=cache_rules(caches), tokenizers=named)
    charged: dict[str, Charged | InvalidArgumentError | None] = {}
    workers = worth(processes, records.values(), WORTH_A_PROCESS)
    for _, part in parallel_map(work, list(records.items()), workers):
        charged |= part
    for fault in charged.values():
        if isinstance(fault, InvalidArgumentError):
            warn_damaged(fault)
    return {key: None if isinstance(of_key := charged[key], InvalidArgumentError) else of_key for key in records}


def _charge_all(
    records: Iterable[tuple[str, Path]],
    *,
    tariffs: Sequence[Tariff],
    prices: Mapping[str, Price],
    rules: Mapping[str, CacheRule],
    tokenizers: Sequence[str],
) -> dict[str, Charged | InvalidArgumentError | None]:
    open_tokenizers(tokenizers)
    with _collecting_rarely():
        return {key: _charged(path, tariffs, prices, rules) for key, path in records}


@contextmanager
def _collecting_rarely() -> Iterator[None]:
    """Let the garbage collector look for cycles less often: records are many small objects, and hardly any cycles."""
    before = gc.get_threshold()
    gc.set_threshold(MANY_OBJECTS, *before[1:])
    try:
        yield
    finally:
        gc.set_threshold(*before)


def _charged(
    path: Path, tariffs: Sequence[Tariff], prices: Mapping[str, Price], rules: Mapping[str, CacheRule]
) -> Charged | InvalidArgumentError | None:
    try:
        with damage_named(path):
            return _charged_record(Record.read(path), tariffs, prices, rules)
    except InvalidArgumentError as error:  # it is damaged, or nobody has named its tokenizer
        return error


def _charged_record(
    record: Record, tariffs: Sequence[Tariff], prices: Mapping[str, Price], rules: Mapping[str, CacheRule]
) -> Charged | None:
    if not record.heads or (record.messages and not any("prompt" in event for event in record.usages)):
        return None
    log = requests_of(record)
    charges = [charge(log, each.rule, marks=each.marks, price=each.price) for each in tariffs]
    if (price := prices.get(record.player)) is None:
        return Charged(charges, None)
    options = record.config.player_options
    rule = rule_of(record.player, options, rules)
    return Charged(charges, None if rule is None else charge(log, rule, marks=marks_of(options), price=price))
