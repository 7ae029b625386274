"""The contract test of strategies finds what breaks it, and passes what keeps it: those of the window, too."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import smartplay_tools as sp
from smartplay_tools.testing import check_strategy
from smartplay_tools.testing.strategy_checks import check_reading, digests
from tests import scripts

FILE = Path(__file__).parent / "data" / "broken_strategies.py"
BROKEN = {
    "TooMuch": r"The choice takes \d+ tokens, and there is room for \d+\.",
    "NoSuchTurn": r"The choice names turn 1, and there are turns 0 to 0\.",
    "Twice": "The choice names turn 0 twice",
    "HidesTheNewest": "The choice masks turn 0, which is pinned",
    "NotText": "The text before turn 0 is 5, not a text",
    "Raises": "ZeroDivisionError",
    "ReturnsNothing": "A strategy returns a Choice, not list",
    "Draws": "not played alike again",
    "Clock": "not played alike again",
    "Shared": "not played alike again",
    "ReadsEverything": "reads up to 320 turns after 260 of them and up to 120 after 60",
}
"""Broken strategies, and what is said of each, in the same process."""
MASK, SUMMARY = {"beyond_history": "mask", "slack": 0.5}, {"summary_tokens": 40, "slack": 0.5}
TOGETHER: tuple[dict[str, Any], ...] = (
    {"own_words": 2},
    {"own_words": 2, **MASK},
    {"own_words": 2, **SUMMARY},
    {"first_turns": 2, **MASK},
    {"first_turns": 2, "notes_tokens": 60, "own_words": 2},
    {"first_turns": 2, "notes_tokens": 40, **SUMMARY},
    {"recall_tokens": 150},
    {"recall_tokens": 150, "first_turns": 2, **MASK},
    {"recall_tokens": 150, "notes_tokens": 60, "own_words": 2},
    {"recall_tokens": 150, **SUMMARY},
    {"memory_tokens": 100},
    {"memory_tokens": 100, **MASK},
    {"memory_tokens": 100, "recall_tokens": 80},
    {"memory_tokens": 100, **SUMMARY},
    {"beyond_result": "offload", "result_tokens": 22},
)
"""Strategies alone and with others."""


def named(name: str) -> sp.Budget:
    return sp.Budget(strategy=f"{FILE}:{name}")


def held_to_it(budget: sp.Budget, episodes: int) -> None:
    digests(budget, episodes)
    check_reading(budget)


@pytest.mark.parametrize("name", BROKEN)
def test_what_is_broken_is_found(name):
    with pytest.raises(AssertionError, match=BROKEN[name]):
        held_to_it(named(name), 6)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "seconds", "sentence"),
    [
        ("SetOrder", 600, "played differently in another process"),
        ("Blocks", 4, "the strategy blocks"),
    ],
)
def test_what_is_broken_elsewhere_is_found(name, seconds, sentence):
    with pytest.raises(AssertionError, match=sentence):
        check_strategy(f"{FILE}:{name}", episodes=6, seconds=seconds)


@pytest.mark.slow
def test_what_keeps_the_contract_passes():
    check_strategy(f"{FILE}:Good:most=4", episodes=40)


@pytest.mark.parametrize("name", ["Good", "Batches:share=0.5"])
def test_what_keeps_the_contract_passes_in_the_same_process(name):
    held_to_it(named(name), 8)


@pytest.mark.parametrize("asked", TOGETHER, ids=" and ".join)
def test_a_record_of_any_of_them_replays_adds_up_and_names_them(asked):
    events: list[Any] = []
    budget = sp.Budget(**{"prompt_tokens": 1_400, "history": 6, **asked})
    with sp.Episode("BanditTwoArmedHighLowFixed-v0", seed=3, budget=budget, transcript=events) as episode:
        result = sp.play(episode, sp.get_player("rule-notes", words="own_words" in asked or "first_turns" in asked))
    assert result.end_reason == "rollout"
    assert {name: result.deviations[name]["played"] for name in asked} == asked
    assert (result.summaries > 0) == ("summary_tokens" in asked)
    assert result.recalls == sum("recalled" in event.get("data", ()) for event in events)
    scripts.check_record(scripts.as_json(events))
