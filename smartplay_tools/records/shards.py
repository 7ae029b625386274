"""The assignment of episodes to the shards of a run."""

from __future__ import annotations


def shard_of(digest: str, trial: int, count: int) -> int:
    """Return the number (from 1) of the shard, of `count`, that plays a trial of the cell with this digest.

    It depends only on the cell and the trial, so an episode stays in its shard when a run is extended.
    """
    return (int(digest, 16) + trial) % count + 1
