"""The grid: where what a prompt shows of a conversation begins, as a function of the conversation alone.

Every unit has a place: the tokens of all units before it, each as it was first shown. Places are divided into blocks,
and with slack the run of units that a prompt shows may begin only at the first unit of a block. So it moves on once per
block, and prompts begin alike in between, as providers' caches need. Without slack a block is one token, and the run is
the longest that fits. Ages move in blocks of steps. Where a run begins never depends on earlier prompts: a retry,
another process or a conversation that goes on from a checkpoint gives the same prompt.
"""

from __future__ import annotations

import functools
import math
from bisect import bisect_left
from collections.abc import Sequence
from fractions import Fraction

__all__ = ["begun_on_grid", "block_of", "jump_of", "moved_on_grid"]


@functools.lru_cache(1_000)
def _share(slack: float, limit: int) -> int:
    """Return a share, rounded down. Slack is read as a decimal: in floats, 0.29 x 100 is less than 29."""
    return max(0, math.floor(Fraction(str(slack)) * limit))


def block_of(slack: float, room: float) -> int:
    """Return the length of a block, a share of the room of all units, in tokens; at least one token."""
    return 1 if math.isinf(room) else max(1, _share(slack, int(room)))


def begun_on_grid(places: Sequence[int], block: int, lowest: int, longest: int) -> int:
    """Return the first unit of a run that may begin at `lowest` or at the first unit of a block.

    `places` has the place of each unit and, last, that of the next. `longest` is the first unit of the longest run that
    fits; the newest unit begins the run if no other may.
    """
    if longest <= lowest:
        return longest
    return min(bisect_left(places, (places[longest - 1] // block + 1) * block, longest), len(places) - 2)


def moved_on_grid(step: int, limit: int, slack: float) -> int:
    """Return the oldest step that is not too old at a step, where `limit` steps before it are not too old.

    With slack it moves on in blocks, towards less: no step that is older than `limit` is ever left, and as many as
    there are beside the share of the limit always are.
    """
    jump = jump_of(slack, limit)
    return 0 if step <= limit else math.ceil((step - limit) / jump) * jump


def jump_of(slack: float, limit: int) -> int:
    """Return by how many steps that boundary moves at once."""
    return _share(slack, limit) + 1
