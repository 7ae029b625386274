"""Context strategies in whole runs: options, estimates and caps."""

from __future__ import annotations

import json
from typing import Any

import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.runs.runner import Run
from tests.evaluation.command import run

BANDIT = "BanditTwoArmedHighLowFixed-v0"
ROOM: dict[str, Any] = {"history": 10, "prompt_tokens": 900, "slack": 0.5}
STRATEGIES: dict[str, dict[str, Any]] = {
    "masking": {"beyond_history": "mask"},
    "notes": {"notes_tokens": 200},
    "summaries": {"summary_tokens": 100},
    "all": {"beyond_history": "mask", "notes_tokens": 200, "summary_tokens": 100},
}


def spent(played: Run) -> int:
    """The tokens in all records of a run, those of summaries included, counted independently."""
    events = (event for record in played.folder.records() for event in sp.read_transcript(record))
    return sum(event["prompt"] + event["reply"] for event in events if event["event"] == "usage")


@pytest.mark.slow
@pytest.mark.parametrize("strategy", STRATEGIES)
def test_what_is_then_played_is_within_the_estimate(strategy, tmp_path):
    options = [f"--{name.replace('_', '-')}={value}" for name, value in {**ROOM, **STRATEGIES[strategy]}.items()]
    command = ("eval", "--games", BANDIT, "--players", "rule-notes", "--trials", 2, *options)
    code, output, stderr = run(*command, "--dry-run", "--json")
    assert code == 0, stderr
    (cell,) = json.loads(output)
    budget = sp.Budget(**ROOM, **STRATEGIES[strategy])
    played = sp.evaluate([BANDIT], ["rule-notes"], budgets=budget, trials=2, out=tmp_path, executor="inline")
    for kind in ("prompt", "reply"):
        took = sum(row["tokens"][kind] for row in played.rows)
        assert cell[f"{kind}_tokens"]["low"] <= took <= cell[f"{kind}_tokens"]["high"]
    calls = sum(row["turns"] + row.get("summaries", 0) for row in played.rows)
    assert cell["calls"]["low"] <= calls <= cell["calls"]["high"]


@pytest.mark.slow
def test_the_longest_episode_of_a_model_has_room_for_its_summaries():
    """A model makes the calls to play that an episode allows, and also those for summaries."""
    command = ("eval", "--games", BANDIT, "--players", "openai:gpt-5-mini", "--trials", 1, "--dry-run", "--json")
    room = ("--history", 10, "--slack", 0.5, "--prompt-tokens", 900, "--reply-tokens", 40)
    (plain,) = json.loads(run(*command, *room)[1])
    (asking,) = json.loads(run(*command, *room, "--summary-tokens", 100)[1])
    assert asking["calls"]["high"] > 1.1 * plain["calls"]["high"]


def test_a_cap_can_pause_an_episode_before_a_summary_and_a_higher_one_goes_on(tmp_path):
    """The first episode alone passes the cap, so that it is paused in its middle, wherever that is."""
    budget = sp.Budget(**ROOM, **STRATEGIES["summaries"])
    arguments: dict[str, Any] = {"games": [BANDIT], "players": ["rule-notes"], "trials": 1, "executor": "inline"}
    whole = sp.evaluate(budgets=[budget], out=tmp_path / "whole", **arguments)
    (record,) = whole.folder.records()
    events = list(sp.read_transcript(record))
    at = next(place for place, event in enumerate(events) if event["event"] == "summary")
    before = sum(event["prompt"] + event["reply"] for event in events[:at] if event["event"] == "usage")
    for out, cap in (("run", before + 1), ("run", 10 * spent(whole))):
        played = sp.evaluate(budgets=[budget], out=tmp_path / out, run_tokens=cap, **arguments)
        assert spent(played) <= cap
    assert played.complete
    assert (tmp_path / "run" / "results.jsonl").read_text() == (tmp_path / "whole" / "results.jsonl").read_text()
