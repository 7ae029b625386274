"""The agent of OpenHands plays with the condenser of its package, and all that it sends is counted.

Its SDK needs Python 3.12: `.ci/framework openhands` runs this in an environment of its own.
"""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest

import smartplay_tools as sp
from smartplay_tools.records import Record

pytest.importorskip("openhands.sdk", reason="needs openhands-sdk: .ci/framework openhands")

EXPERIMENTS = Path(__file__).parents[2] / "experiments"


def test_its_summaries_are_asked_for_and_every_prompt_is_on_record(monkeypatch):
    monkeypatch.syspath_prepend(str(EXPERIMENTS))
    hosts = importlib.import_module("hosts")
    events: list = []
    budget = sp.Budget(prompt_tokens=hosts.CAP, history=None)
    with sp.Episode(hosts.GAMES[0], seed=1, context="host", budget=budget, transcript=events) as episode:
        hosts.play(hosts.APART["openhands-summary"], "rule-notes", episode)
    result, record = episode.result, Record(events)
    assert result.end_reason == "rollout"
    assert result.score > 40
    asked = [event for event in record.sent if event["tokens"] > 0]
    assert len(asked) > result.steps  # some of them ask for a summary
    assert max(event["tokens"] for event in asked) < 2 * hosts.CAP
    assert result.over_prompts == sum(event["over"] for event in asked)
    assert sp.replay(events).identical
