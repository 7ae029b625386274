"""The conversation of `conformance.py` through every adapter. A new adapter is one more module of `rows`."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

from tests.adapters import conformance, situations
from tests.adapters.conformance import BASIC, BROKEN, BUDGETS, HOSTS, IDLE, OURS, Turns, line_of, table
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


@pytest.mark.parametrize("budget", BUDGETS)
@pytest.mark.parametrize("row", ROWS)
def test_the_game_cannot_tell_adapters_apart(row, budget):
    conformance.judge_end(WINDOW[row], budget)


@pytest.mark.parametrize("row", ROWS)
def test_the_tools_of_memory(row):
    conformance.judge_memory(WINDOW[row])


@pytest.mark.parametrize("row", ROWS)
def test_numbers_of_actions(row):
    conformance.judge_numbers(WINDOW[row])


@pytest.mark.parametrize("row", ROWS)
def test_words_without_a_call(row):
    conformance.judge(WINDOW[row], IDLE, BUDGETS["tight"])


@pytest.mark.parametrize("row", named({name: row for name, row in WINDOW.items() if row.broken_json}))
def test_arguments_that_are_no_json(row):
    conformance.judge(WINDOW[row], BROKEN, BUDGETS["tight"])


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


@pytest.mark.parametrize(
    "row", [pytest.param(row, marks=() if row == "Agents SDK" else pytest.mark.slow) for row in WINDOW]
)
def test_mistakes_without_end_are_asked_for_ten_times(row):
    conformance.judge_mistakes_without_end(WINDOW[row])


@pytest.mark.parametrize("row", ROWS)
def test_prompts_for_a_summary_are_answered_in_between(row):
    conformance.judge_summaries(WINDOW[row])


@pytest.mark.parametrize("row", ROWS)
def test_the_smaller_of_two_caps_on_replies_applies(row):
    conformance.judge_caps(WINDOW[row])


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


@pytest.mark.parametrize("row", ROWS)
def test_the_table_says_what_the_rows_show(row):
    conformance.check_line(WINDOW[row])


@pytest.mark.parametrize("row", HOST)
def test_the_table_says_what_the_rows_show_of_hosts(row):
    assert (line_of(HOST[row])["unknown tool"] == "answered") == HOST[row].carries("jump", {"how": "high"})
