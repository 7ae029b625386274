"""Seeds: those that users give, integers of any type, such as numpy's; and those that follow from the seed of a run."""

from __future__ import annotations

import hashlib
import operator
from typing import Any

from smartplay_tools.errors import InvalidArgumentError

__all__ = ["player_seed", "trial_seed"]


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


def trial_seed(seed: int, game: str, trial: int) -> int:
    """Return the seed of a trial: below 2**31, different for every trial of a game.

    It follows from the seed of the run, so one number determines all its worlds.
    """
    start = hashlib.sha256(f"{seed} {game}".encode()).digest()[:4]
    return (int.from_bytes(start, "big") + trial) % 2**31


def player_seed(seed: int, repeat: int) -> int:
    """Return the seed of a player in a world: the world's, or another one each time it is played again."""
    if not repeat:
        return seed
    return int.from_bytes(hashlib.sha256(f"{seed} {repeat}".encode()).digest()[:4], "big") % 2**31
