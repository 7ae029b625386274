"""The prefix: how much of a prompt's beginning is the same as in the prompt before.

A provider's prompt cache can serve that part; records and costs count its tokens.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import compress, count
from operator import is_not
from typing import Any


def common_beginning(forms: Sequence[Any], before: Sequence[Any], *, is_equal: bool = False) -> int:
    """Return how many objects at the beginning are the same, or with `is_equal` forms of messages that say the same."""
    if forms[: len(before)] == before:  # the window has not moved; lists compare in C, and a form equals itself alone
        return len(before)
    for place in compress(count(), map(is_not, forms, before)):
        if not is_equal or forms[place].message != before[place].message:
            return place
    return min(len(forms), len(before))
