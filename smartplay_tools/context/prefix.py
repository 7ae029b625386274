"""The prefix: how much of a prompt's beginning is the same as in the prompt before.

A provider's prompt cache can serve that part; records and costs count its tokens.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import compress, count, takewhile
from operator import is_not

from smartplay_tools.context.tokens import PRIMING, TokenCounter
from smartplay_tools.context.turns import Form
from smartplay_tools.context.view import Head


def common_beginning(forms: Sequence[Form], before: Sequence[Form], *, is_equal: bool) -> int:
    """Return how many messages at the beginning are the same forms, or with `is_equal` say the same."""
    if forms[: len(before)] == before:  # the window has not moved; lists compare in C, and a form equals itself alone
        return len(before)
    for place in compress(count(), map(is_not, forms, before)):
        if not is_equal or forms[place].message != before[place].message:
            return place
    return min(len(forms), len(before))


def common_head(was: Head, head: Head, tools: int, counter: TokenCounter) -> tuple[int, bool]:
    """Return the tokens of tools and messages that two heads begin with, and whether they are the same head."""
    if head is was:
        return head.tokens - PRIMING, True
    if head.tools != was.tools:
        return 0, False
    pairs = takewhile(lambda pair: pair[0] == pair[1], zip(head.messages, was.messages, strict=False))
    return tools + counter.messages(message for message, _ in pairs), False
