"""Custom strategies: from a file, an installed package or the running program, by name.

`Budget.strategy` is a name of the group of entry points `smartplay_tools.strategies`, one that this program has
registered, or `FILE.py:CLASS`; options may follow, as in `FILE.py:CLASS:turns=3`. A name in a record never imports a
file: a record can come from a stranger. A class that the user has named in this process is used again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

from smartplay_tools.context.strategies.base import BudgetStrategy
from smartplay_tools.context.strategies.choices import Strategy
from smartplay_tools.errors import InvalidArgumentError, SmartPlayError, in_one_line
from smartplay_tools.games.game_registry import packages_are_imported
from smartplay_tools.registry import Registry, is_in_file, read_file
from smartplay_tools.types import Budget
from smartplay_tools.types.arguments import value_in

ENTRY_POINTS = "smartplay_tools.strategies"
"""The group under which other packages declare strategies."""

_REGISTRY = Registry("strategy", {}, ENTRY_POINTS)


class Brought(BudgetStrategy):
    """Leaves the choice of the turns to a strategy that was brought."""

    name = "strategy"
    option_help = "A strategy of your own, FILE.py:CLASS, or of an installed package, by its name."

    @classmethod
    def refusal(cls, budget: Budget, history: int | None) -> str | None:
        """Return why it cannot be combined with the rest of the budget: it chooses what others would decide."""
        for name in ("beyond_history", "summary_tokens", "first_turns", "slack"):
            if getattr(budget, name) != Budget.model_fields[name].default:
                return f"strategy={budget.strategy} chooses the turns itself, so {name} would do nothing; leave it out."
        return None


@dataclass(frozen=True)
class Loaded:
    """A class that was imported, or registered."""

    make: Callable[..., Any]
    sha256: str | None
    """The digest of its file; None if it is not of a file."""


_LOADED: dict[str, Loaded] = {}
"""The strategies that this process has been asked for, by their names without options."""


def register_strategy(name: str, make: Callable[..., Strategy]) -> None:
    """Register a strategy by a name in this process, as a notebook does; a package declares an entry point instead."""
    if not name or ":" in name or name == "none" or name in _REGISTRY:
        raise InvalidArgumentError(f"{name!r} cannot be the name of a strategy, or is taken; choose another.")
    _LOADED[name] = Loaded(make, None)


def load_strategy(name: str) -> Loaded:
    """Import a strategy that the user has named; `InvalidArgumentError` if that is not possible."""
    place, _ = parted(name)
    if place not in _LOADED:
        if is_in_file(place):
            make = read_file(place, "strategy")
            _LOADED[place] = Loaded(make, file_sha256(place))
        else:
            _LOADED[place] = Loaded(_REGISTRY[place], None)
    return _LOADED[place]


def recorded_strategy(name: str, digest: str | None) -> Loaded:
    """Return the strategy that a record names, without importing a file for it; `digest` is that of its file.

    The file may have been moved; only its content matters.
    """
    place, _ = parted(name)
    if not is_in_file(place):
        if place not in _LOADED and place in _REGISTRY and not packages_are_imported():
            raise InvalidArgumentError(f"{place} is a strategy of an installed package; --plugins imports it.")
        return load_strategy(name)
    attribute = place.rpartition(":")[2]
    for where, held in _LOADED.items():
        if held.sha256 == digest and where.rpartition(":")[2] == attribute:
            return held
    if place in _LOADED:
        raise InvalidArgumentError(
            f"{place} has changed since the record was made; name an unchanged copy of the file with --strategy."
        )
    raise InvalidArgumentError(
        f"The record was played with the strategy {place}; name it with --strategy to import it."
    )


def make_strategy(name: str, loaded: Loaded) -> Strategy:
    """Return a new object of a strategy, with the options of its name, for one episode."""
    _, options = parted(name)
    try:
        made = loaded.make(**options)
    except SmartPlayError:
        raise
    except Exception as error:  # whatever the user's class does
        problem = f"{type(error).__name__}: {in_one_line(error)}"
        raise InvalidArgumentError(f"The strategy {name} cannot be made with these options: {problem}.") from error
    if not isinstance(made, Strategy):
        raise InvalidArgumentError(f"The strategy {name} has no method choose(past, room).")
    return made


def parted(name: str) -> tuple[str, dict[str, Any]]:
    """Split a name such as `FILE.py:CLASS:turns=3` into place and options; a value that is not JSON is text."""
    parts, options = name.split(":"), {}
    while len(parts) > 1 and "=" in parts[-1]:
        key, _, value = parts.pop().partition("=")
        if key in options or not key.isidentifier():
            raise InvalidArgumentError(f"The options of the strategy {name} are KEY=VALUE, each key once.")
        options[key] = value_in(value)
    return ":".join(parts), options


def file_sha256(place: str) -> str | None:
    """Return the digest of a strategy's file; None if it is not in a file."""
    return sha256(Path(place.rpartition(":")[0]).read_bytes()).hexdigest() if is_in_file(place) else None
