"""The conversation of `conformance.py` through every adapter. A new adapter is one more module of `rows`."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

from tests.adapters import conformance, situations
from tests.adapters.conformance import BASIC, BROKEN_JSON, BUDGETS, CHECKS, HOSTS, IDLE, OURS, Turns, line_of, table
from tests.adapters.rows import HOST, WINDOW


def named(rows: dict[str, Any]) -> list[Any]:
    return [pytest.param(row, marks=pytest.mark.slow if rows[row].slow else ()) for row in rows]


ROWS = named(WINDOW)


@pytest.mark.parametrize("budget", ["tight", "lazy"])
def test_these_budgets_make_turns_leave_the_window(budget):
    episode, events = conformance.fresh(BUDGETS[budget])
    with episode:
        conformance.by_conversation(episode, BASIC)
    shown = [sum(last - first + 1 for first, last in e["turns"]) for e in events if e["event"] == "view"]
    assert max(turn - turns for turn, turns in enumerate(shown)) >= 4


def is_slow(row: str, check: str) -> bool:
    """Whether only the slow tests make a check; of the mistakes without end one row is enough for the fast ones."""
    return WINDOW[row].slow or (check == "mistakes without end" and row != "Agents SDK")


@pytest.mark.parametrize(
    ("row", "check"),
    [
        pytest.param(row, check, marks=pytest.mark.slow if is_slow(row, check) else ())
        for row in WINDOW
        for check in CHECKS
        if WINDOW[row].broken_json or check != BROKEN_JSON
    ],
)
def test_the_game_cannot_tell_adapters_apart(row, check):
    CHECKS[check](WINDOW[row])


@pytest.mark.parametrize(
    ("row", "situation"),
    [
        pytest.param(row, situation, marks=pytest.mark.slow if WINDOW[row].slow else ())
        for row in WINDOW
        for situation in situations.of(WINDOW[row])
    ],
)
def test_what_hosts_do(row, situation, caplog):
    situations.SITUATIONS[situation](WINDOW[row], caplog)


@pytest.mark.parametrize("row", ROWS)
def test_two_episodes_interleaved(row):
    """Each episode has its own thread; their replies alternate."""

    async def both() -> None:
        mine = Turns()
        others = mine.other_side()
        one = asyncio.to_thread(conformance.judge, WINDOW[row], BASIC, BUDGETS["tight"], mine)
        other = asyncio.to_thread(conformance.judge, WINDOW[row], IDLE, BUDGETS["free"], others)
        await asyncio.gather(one, other)
        assert min(mine.taken_in_turn, others.taken_in_turn) == len(BASIC)

    asyncio.run(both())


@pytest.mark.parametrize("row", named(HOST))
async def test_the_game_cannot_tell_hosts_apart(row, tmp_path):
    await conformance.judge_hosts(HOST[row], tmp_path)


# --- What is enforced where: the table in the documentation -------------------------------------------------------


def test_every_line_of_the_table_has_a_row():
    lines = {**table(OURS), **table(HOSTS)}.keys()
    here = {line_of(row)["interface"] for row in (*WINDOW.values(), *HOST.values())}
    assert here <= lines
    files = [path.read_text(encoding="utf-8") for path in Path(__file__).parent.glob("test_*.py")]
    for line in lines - here:  # those of frameworks with environments of their own
        assert any(f'"{line}"' in text and "conformance import" in text for text in files), f"{line} has no row"


@pytest.mark.parametrize("row", HOST)
def test_the_table_says_what_the_rows_show_of_hosts(row):
    assert (line_of(HOST[row])["unknown tool"] == "answered") == HOST[row].carries("jump", {"how": "high"})
