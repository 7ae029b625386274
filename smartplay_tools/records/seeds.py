"""Seeds of a run: every trial's seed follows from the seed of the run, so one number determines all its worlds.

Playing a run and checking the run of another both derive them here.
"""

from __future__ import annotations

import hashlib


def trial_seed(seed: int, game: str, trial: int) -> int:
    """Return the seed of a trial: below 2**31, different for every trial of a game."""
    start = hashlib.sha256(f"{seed} {game}".encode()).digest()[:4]
    return (int.from_bytes(start, "big") + trial) % 2**31
