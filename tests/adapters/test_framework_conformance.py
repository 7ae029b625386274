"""The conversation of `conformance.py` through the adapters of frameworks, and that the documentation has them all."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.adapters import conformance, situations
from tests.adapters.conformance import CHECKS, HOSTS, OURS, checks_of, line_of, table
from tests.adapters.rows import FRAMEWORKS, QUICK, rows

pytestmark = pytest.mark.slow

WINDOW, HOST = rows(FRAMEWORKS)


@pytest.mark.parametrize(("row", "check"), [(row, check) for row in WINDOW for check in checks_of(WINDOW[row])])
def test_the_game_cannot_tell_adapters_apart(row, check):
    CHECKS[check](WINDOW[row])


@pytest.mark.parametrize(("row", "situation"), [(row, name) for row in WINDOW for name in situations.of(WINDOW[row])])
def test_what_hosts_do(row, situation, caplog):
    situations.SITUATIONS[situation](WINDOW[row], caplog)


@pytest.mark.parametrize("row", HOST)
async def test_the_game_cannot_tell_hosts_apart(row, tmp_path):
    await conformance.judge_hosts(HOST[row], tmp_path)


@pytest.mark.parametrize("row", HOST)
def test_the_table_says_what_the_rows_show_of_hosts(row):
    assert (line_of(HOST[row])["unknown tool"] == "answered") == HOST[row].carries("jump", {"how": "high"})


def test_every_line_of_the_table_has_a_row():
    lines = {**table(OURS), **table(HOSTS)}.keys()
    quick = rows(QUICK)
    here = {line_of(row)["interface"] for kind in (WINDOW, HOST, *quick) for row in kind.values()}
    assert here <= lines
    files = [path.read_text(encoding="utf-8") for path in Path(__file__).parent.glob("test_*.py")]
    for line in lines - here:  # those of frameworks with environments of their own
        assert any(f'"{line}"' in text and "conformance import" in text for text in files), f"{line} has no row"
