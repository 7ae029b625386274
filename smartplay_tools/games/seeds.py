"""Seeds as users give them: integers of any type, such as numpy's."""

from __future__ import annotations

import operator
from collections.abc import Iterable, Set
from typing import Any

from smartplay_tools.errors import InvalidArgumentError


def check_seed(seed: object) -> int:
    """Return a seed as an int; raise `InvalidArgumentError` unless it is a whole number, 0 or more."""
    number = whole(seed)
    if number is None or number < 0:
        raise InvalidArgumentError(f"seed must be a whole number, 0 or more, not {seed!r}.")
    return number


def check_seeds(seed: Any, count: int) -> list[int | None]:
    """Return a seed for each world: s, s + 1, ... from one number s; or one given for each, None for no seed."""
    if seed is None:
        return [None] * count
    is_several = isinstance(seed, Iterable) and not isinstance(seed, str | bytes | Set)
    if not is_several or whole(seed) is not None:
        first = check_seed(seed)
        return [first + number for number in range(count)]
    seeds = [None if each is None else check_seed(each) for each in seed]
    if len(seeds) != count:
        raise InvalidArgumentError(f"seed must be a number or {count} of them, not {len(seeds)}.")
    return seeds


def whole(value: Any) -> int | None:
    """Return an integer of any type, such as numpy's, as an int; None for anything else, including booleans."""
    if isinstance(value, bool):
        return None
    try:
        return int(operator.index(value))
    except TypeError:
        return None
