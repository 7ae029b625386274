"""A result lists everything in which its episode differs from the paper's protocol, without a run around it."""

from __future__ import annotations

import dataclasses

import pytest

import smartplay_tools as sp
from smartplay_tools.games import get_spec

HANOI, RPS = "Hanoi3Disk-v0", "RockPaperScissorBasic-v0"
TOOLS = {
    "protocol": {"paper": "paper", "played": "tools"},
    "manual": {"paper": "pinned", "played": "tool"},
    "batch": {"paper": "one action a prompt", "played": "all"},
}


def deviations(game=HANOI, player="rule", protocol="tools", **options):
    with sp.Episode(game, seed=1, **options) as episode:
        return sp.play(episode, sp.get_player(player), protocol=protocol).deviations


def test_the_papers_protocol_deviates_in_nothing():
    assert deviations(protocol="paper") == {}
    assert deviations(protocol="paper", manual="pinned", batch="first_act") == {}


def test_tool_calls_are_a_deviation_and_so_are_their_manual_and_batches():
    assert deviations() == TOOLS
    assert set(deviations(manual="pinned", batch="first_act")) == {"protocol"}
    assert deviations(protocol="paper", manual="none") == {"manual": {"paper": "pinned", "played": "none"}}


@pytest.mark.parametrize(
    ("budget", "expected"),
    [
        ({"prompt_tokens": 2_000, "result_tokens": None}, {"prompt_tokens": 2_000}),
        ({"reply_tokens": 300}, {"reply_tokens": 300}),
        ({"episode_tokens": 90_000}, {"episode_tokens": 90_000}),
        ({"result_tokens": 150}, {"result_tokens": 150}),
        ({"tool_calls": 20}, {"tool_calls": 20}),
        ({"tool_calls": 5_000}, {}),
        ({"tool_calls": None}, {}),
    ],
)
def test_every_cap_is_a_deviation(budget, expected):
    fields = deviations(budget=sp.Budget(**budget))
    assert fields == {**TOOLS, **{name: {"paper": None, "played": cap} for name, cap in expected.items()}}


def test_a_cap_on_results_that_follows_from_the_prompts_is_one_too():
    fields = deviations(budget=sp.Budget(prompt_tokens=800))
    assert fields["result_tokens"]["played"] > 0


def test_history_rollout_slack_and_a_player_that_knows_more():
    assert deviations(budget=sp.Budget(history=3))["history"] == {"paper": 30, "played": 3}
    assert deviations(budget=sp.Budget(slack=0.5))["slack"] == {"paper": 0.0, "played": 0.5}
    shorter = dataclasses.replace(get_spec(RPS), rollout=5)
    assert deviations(shorter)["rollout"] == {"paper": 50, "played": 5}
    assert deviations(player="oracle")["player"]["played"].startswith("privileged")


def test_a_host_decides_itself_what_its_model_sees():
    with sp.Episode(HANOI, seed=1, context="host") as episode:
        episode.call("act", {"action": "1"})
    assert episode.result.deviations["context"] == {"paper": "window", "played": "host"}


def test_what_a_game_changes_is_listed_with_the_rest():
    assert deviations("MessengerL1-v0")["texts"] == {"paper": "original", "played": "grammar"}
