"""Seeds as users give them: integers of any type, such as numpy's."""

from __future__ import annotations

import operator
from typing import Any

from smartplay_tools.errors import InvalidArgumentError


def check_seed(seed: object) -> int:
    """Return a seed as an int; raise `InvalidArgumentError` unless it is a whole number, 0 or more."""
    number = whole(seed)
    if number is None or number < 0:
        raise InvalidArgumentError(f"seed must be a whole number, 0 or more, not {seed!r}.")
    return number


def whole(value: Any) -> int | None:
    """Return an integer of any type, such as numpy's, as an int; None for anything else, including booleans."""
    if isinstance(value, bool):
        return None
    try:
        return int(operator.index(value))
    except TypeError:
        return None
