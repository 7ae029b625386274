"""The table of rules is sound, and an answer that comes in pieces is the answer that comes whole, in every dialect."""

from __future__ import annotations

from datetime import date
from itertools import product

import pytest
from smartplay_openai import CHAT

from smartplay_tools.providers.tables import ANY, provider_at, providers, rows
from tests.dialects.rules import DIALECTS, RULES
from tests.dialects.scripts import HOSTILE, ODD, SOLVED
from tests.dialects.server import in_pieces, whole_answer

SAID = [*SOLVED[:2], *HOSTILE.values(), *ODD.values()]
CHATS = [dialect for dialect in DIALECTS.values() if dialect.interface == "chat"]


def test_every_rule_is_of_a_dialect_and_says_where_it_is_from():
    for rule in RULES:
        assert {*rule.dialects} <= {*DIALECTS}
        assert rule.rule
        assert rule.source
        assert rule.read >= date(2026, 11, 26)
    assert all(dialect.rules("refuses") for dialect in DIALECTS.values())


READ = "name hosts cap defined end_fields not_counted parts usage field optional error end limit caches pictures"


def test_a_provider_s_file_has_nothing_that_nobody_reads():
    for name, table in providers().items():
        assert {*table} <= {*READ.split()}, name
    reported = [row for kind in ("field", "optional", "end", "limit") for _, row in rows(kind) if "holds" not in row]
    assert all(row["source"] and row["read"] >= date(2026, 11, 26) for row in reported)


def test_a_cap_in_a_provider_s_file_holds_at_its_hosts():
    assert all("hosts" in table for name, table in providers().items() if "cap" in table and name != ANY)
    own = [dialect for dialect in CHATS if "{port}" not in dialect.base_url]
    assert all(dialect.name.startswith(provider_at(dialect.base_url)) for dialect in own)


def test_every_name_of_thoughts_at_the_tests_server_is_in_the_provider_s_file():
    known = {(who, row["name"]) for who, row in rows("field")}
    said = [rule for rule in RULES if rule.kind == "says" and rule.act.func.__name__ in ("thoughts_as", "thoughts_in")]
    assert {(who, rule.act.keywords["name"]) for rule in said for who in rule.dialects} <= known


@pytest.mark.parametrize(
    "seeds", [range(3), pytest.param(range(3, 3 + 100_000 // (len(CHATS) * len(SAID))), marks=pytest.mark.slow)]
)
def test_an_answer_in_pieces_is_the_answer(seeds):
    """Every reply in every dialect, cut by each seed."""
    for dialect, said in product(CHATS, SAID):
        answer = whole_answer(dialect, said, 1)
        whole = CHAT.reply(answer)
        for seed in seeds:
            chunks = [chunk for chunk in in_pieces(dialect, answer, seed) if not isinstance(chunk, str)]
            joined = CHAT.reply(CHAT.assemble(chunks))
            assert (joined.message, joined.usage) == (whole.message, whole.usage), (dialect.name, said, seed)
