"""A sum that is the same on every version of Python, and the largest number that is ever added.

Since Python 3.12 `sum` rounds floats less often than before, so a cost in a row, or an action of a rule player, would
depend on the version with which an episode was played.
"""

from __future__ import annotations

import operator
from collections.abc import Iterable
from functools import reduce

__all__ = ["added"]

MOST = 10**15
"""More than anything in a record counts."""


def added(numbers: Iterable[float]) -> float:
    """Return the sum of numbers, added one after another; 0 if there are none."""
    return reduce(operator.add, numbers, 0)
