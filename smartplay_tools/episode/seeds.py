"""The seeds of a run's worlds and players: all follow from the seed of the run."""

from __future__ import annotations

import hashlib

__all__ = ["player_seed", "trial_seed"]


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
