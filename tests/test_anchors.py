"""First turns that stay: which, where they stand, what is asked for, and what is on record."""

from __future__ import annotations

import pytest

import smartplay_tools as sp
from smartplay_tools.records import Record
from tests import scripts

RPS = "RockPaperScissorDifferentScore-v0"


def played(**budget):
    events = []
    with sp.Episode(RPS, seed=3, budget=sp.Budget(**budget), transcript=events) as episode:
        result = sp.play(episode, sp.get_player("rule-notes"))
    return result, scripts.as_json(events)


def test_the_first_turns_are_in_every_prompt():
    result, events = played(first_turns=2, prompt_tokens=1_000, result_tokens=60)
    assert result.end_reason == "rollout"
    assert result.deviations["first_turns"] == {"paper": None, "played": 2}
    views = [event for event in events if event["event"] == "view"]
    assert all({0, 1} <= {at for first, last in view["turns"] for at in range(first, last + 1)} for view in views[2:])
    assert views[-1]["dropped_turns"] > 30


def test_they_stand_in_front_of_the_summary():
    _, events = played(first_turns=2, summary_tokens=40, slack=0.5, prompt_tokens=1_000)
    sent = [one.prompt for one in Record(events).sent_prompts() if not one.prompt.asks_for_summary][-1]
    contents = [str(message["content"]) for message in sent.messages]
    [summary] = [at for at, text in enumerate(contents) if text.startswith("Your summary of what has left")]
    assert [message["role"] for message in sent.messages[:summary]].count("assistant") == 2


def test_where_nothing_leaves_it_is_refused():
    with pytest.raises(sp.InvalidArgumentError, match="first_turns has nothing to keep"):
        sp.Episode(RPS, seed=1, budget=sp.Budget(first_turns=1, history=None))
