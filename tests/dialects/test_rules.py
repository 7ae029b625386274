"""The table of rules is sound, and an answer that comes in pieces is the answer that comes whole, in every dialect."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import date
from itertools import product
from typing import Any

import pytest
from smartplay_openai import CHAT

from tests.dialects.rules import DIALECTS, LIMITS, RULES, Dialect
from tests.dialects.said import Said
from tests.dialects.scripts import HOSTILE, ODD, SOLVED
from tests.dialects.server import in_pieces, whole_answer
from tests.dialects.ways import WAYS

SAID = [*SOLVED[:2], *HOSTILE.values(), *ODD.values()]
CHATS = [dialect for dialect in DIALECTS.values() if dialect.interface == "chat"]


def test_every_rule_is_of_a_dialect_and_says_where_it_is_from():
    for rule in RULES:
        assert {*rule.dialects} <= {*DIALECTS}
        assert rule.rule
        assert rule.source
        assert rule.read >= date(2026, 11, 26)
    assert all(dialect.rules("refuses") for dialect in DIALECTS.values())


def test_every_limit_is_of_a_way_and_a_dialect():
    for limit in LIMITS:
        assert {*limit.dialects} <= {*DIALECTS}
        assert all(any(part in way for way in WAYS) for part in limit.ways)


def replies(dialect: Dialect, said: Said, seed: int) -> tuple[Any, Any]:
    """A reply read from the whole answer, and from its pieces."""
    whole = whole_answer(dialect, said, seed)
    chunks = [chunk for chunk in in_pieces(dialect, whole, seed) if not isinstance(chunk, str)]
    return CHAT.reply(whole), CHAT.reply(CHAT.assemble(chunks))


def check_cuts(seeds: Iterable[int]) -> None:
    """Cut every reply in every dialect, by each seed."""
    for dialect, said, seed in product(CHATS, SAID, seeds):
        whole, joined = replies(dialect, said, seed)
        assert joined.message == whole.message, (dialect.name, said, seed)
        assert joined.usage == whole.usage, (dialect.name, said, seed)


def test_an_answer_in_pieces_is_the_answer():
    check_cuts(range(3))


@pytest.mark.slow
def test_an_answer_in_a_hundred_thousand_cuts_is_the_answer():
    check_cuts(range(3, 3 + 100_000 // (len(CHATS) * len(SAID)) + 1))
