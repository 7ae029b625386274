"""The conversation of `conformance.py` through every adapter. A new adapter is one more module of `rows`."""

from __future__ import annotations

import pytest

from tests.adapters import conformance
from tests.adapters.conformance import BASIC, BROKEN_JSON, BUDGETS, CHECKS, checks_of, line_of
from tests.adapters.rows import QUICK, rows

WINDOW, HOST = rows(QUICK)

OF_ANOTHER_WIRE = ("the budget `tight`", BROKEN_JSON)
"""The checks that fast tests make of a row that repeats another one; they make all of them of the first one."""


def is_slow(row: str, check: str) -> bool:
    """Whether only the slow tests make a check."""
    is_repeated = WINDOW[row].repeats and check not in OF_ANOTHER_WIRE
    takes_long = row == "OpenAI player" and check == "mistakes without end"
    return WINDOW[row].slow or is_repeated or takes_long


@pytest.mark.parametrize("budget", ["tight", "lazy"])
def test_these_budgets_make_turns_leave_the_window(budget):
    episode, events = conformance.fresh(BUDGETS[budget])
    with episode:
        conformance.by_conversation(episode, BASIC)
    shown = [sum(last - first + 1 for first, last in e["turns"]) for e in events if e["event"] == "view"]
    assert max(turn - turns for turn, turns in enumerate(shown)) >= 4


@pytest.mark.parametrize(
    ("row", "check"),
    [
        pytest.param(row, check, marks=pytest.mark.slow if is_slow(row, check) else ())
        for row in WINDOW
        for check in checks_of(WINDOW[row])
    ],
)
def test_the_game_cannot_tell_adapters_apart(row, check):
    CHECKS[check](WINDOW[row])


@pytest.mark.parametrize("row", [pytest.param(row, marks=pytest.mark.slow if HOST[row].slow else ()) for row in HOST])
async def test_the_game_cannot_tell_hosts_apart(row, tmp_path):
    await conformance.judge_hosts(HOST[row], tmp_path)


@pytest.mark.parametrize("row", HOST)
def test_the_table_says_what_the_rows_show_of_hosts(row):
    assert (line_of(HOST[row])["unknown tool"] == "answered") == HOST[row].carries("jump", {"how": "high"})
