"""The dialects and their rules, as `rules.toml` lists them."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date
from functools import partial
from pathlib import Path
from typing import Any, Literal

from tests.dialects import oddities, refusals

Kind = Literal["refuses", "overlooks", "says", "streams"]


@dataclass(frozen=True)
class Rule:
    """A row of the table."""

    dialects: Sequence[str]
    kind: Kind
    rule: str
    source: str
    read: date
    act: partial[Any]
    """A function of `refusals` where it refuses or overlooks, of `oddities` where it says or streams."""
    optional: bool = False
    """Whether it refuses a field that can be left out: it may do so once in a game."""


@dataclass(frozen=True)
class Limit:
    """What a framework does not do at some servers, whatever this package does."""

    ways: Sequence[str]
    """Parts of the names of ways in."""
    dialects: Sequence[str]
    limit: str
    set: str
    """What a user can set."""
    without: Sequence[str] = ()
    """What the server then does not do: "thoughts", or functions of rules; "play" if there is no game."""


@dataclass(frozen=True)
class Dialect:
    """A server."""

    name: str
    model: str
    interface: Literal["chat", "responses", "messages"]
    base_url: str
    error: str = "openai"
    """The form of its errors."""
    ids: str = "call_{0}x{1}"
    """The ids of its calls, of the numbers of the reply and of the call."""
    cannot: Sequence[str] = ()
    """What its replies cannot be: `plainer` of `said` says what there is."""

    def rules(self, kind: Kind) -> list[Rule]:
        return [rule for rule in RULES if rule.kind == kind and self.name in rule.dialects]


def _rule(act: str, kind: Kind, **row: Any) -> Rule:
    module, options = refusals if kind in ("refuses", "overlooks") else oddities, row.pop("with", {})
    return Rule(**row, kind=kind, act=partial(getattr(module, act), **options))


_TABLE = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
DIALECTS = {row["name"]: Dialect(**row) for row in _TABLE["dialect"]}
RULES = [_rule(**row) for row in _TABLE["rule"]]
LIMITS = [Limit(**row) for row in _TABLE["client_limit"]]


def limits(way: str, dialect: Dialect) -> list[Limit]:
    """The limits of a way in at a server."""
    return [limit for limit in LIMITS if dialect.name in limit.dialects and any(part in way for part in limit.ways)]
