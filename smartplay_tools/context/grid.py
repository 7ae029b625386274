"""The grid: which consecutive units of a conversation a prompt shows, as a function of the conversation alone.

Every unit has a place: the tokens of all units before it, each as it was first shown. With slack, the run of units that
a prompt shows may begin only at the first unit at or after a multiple of `block`. So it moves on once per block, and
prompts begin alike in between, as providers' caches need. Without slack a block is one token, and the run is the
longest that fits. Where it begins never depends on earlier prompts: a retry, another process or a conversation that
goes on from a checkpoint gives the same prompt.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Sequence

__all__ = ["block_of", "first_on_grid", "jump_of", "moved_on_grid"]


def block_of(slack: float, room: float) -> int:
    """Return the length of a block, a share of the room of all units, in tokens; at least one token."""
    return 1 if math.isinf(room) else max(1, math.floor(slack * room))


def first_on_grid(
    places: Sequence[int], block: int, lowest: int, room: float, tokens: Callable[[int], int]
) -> tuple[int, int]:
    """Return the first unit of the run, and the number of its block.

    `places` has the place of each unit and, last, that of the next. No unit before `lowest` may begin the run, and the
    newest unit begins it if nothing else fits. `tokens` returns the tokens of a run from a unit on, pinned units before
    it included; they fall as the beginning moves on.
    """
    newest = len(places) - 2

    def unit(number: int) -> int:
        return min(max(bisect_left(places, number * block), lowest), newest)

    blocks = range(places[-1] // block + 2)
    number = bisect_left(blocks, x=True, key=lambda number: tokens(unit(number)) <= room)
    return unit(number), number


def moved_on_grid(step: int, limit: int, slack: float) -> int:
    """Return the oldest step that is not too old at a step, where `limit` steps before it are not too old.

    With slack it moves on in blocks, towards less: no step that is older than `limit` is ever left.
    """
    jump = jump_of(slack, limit)
    return 0 if step <= limit else math.ceil((step - limit) / jump) * jump


def jump_of(slack: float, limit: int) -> int:
    """Return by how many steps that boundary moves at once; at least one."""
    return max(1, math.floor(slack * limit))
