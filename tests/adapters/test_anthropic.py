"""Anthropic: the conversion of prompts and answers, and what happens when the server is busy."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from smartplay_anthropic import AnthropicPlayer, reply, request

import smartplay_tools as sp
from smartplay_tools.players import BrokenAnswerError
from tests.adapters.anthropic_stub import USAGE, AnthropicStub
from tests.adapters.conformance import act, calling, fresh

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def _no_proxy(monkeypatch):
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")


def play(stub: AnthropicStub, budget: sp.Budget, **options: object) -> sp.EpisodeResult:
    episode, _ = fresh(budget)
    with stub, episode, AnthropicPlayer("m", base_url=stub.url, api_key="k", pause=0.0, **options) as player:
        return sp.play(episode, player)


def test_writes_that_are_kept_for_an_hour_are_told_apart():
    usage = {**USAGE, "cache_creation": {"ephemeral_5m_input_tokens": 0, "ephemeral_1h_input_tokens": 2}}
    kept = reply({"content": [], "usage": usage}).usage
    assert kept == sp.Usage(prompt=10, reply=4, cached=3, written=2, written_1h=2)


def test_an_answer_without_content_is_not_a_reply_that_was_cut():
    with pytest.raises(BrokenAnswerError, match="no content blocks: It is down") as raised:
        reply({"error": {"message": "It is down."}, "content": None, "stop_reason": "max_tokens", "usage": USAGE})
    assert raised.value.usage == sp.Usage(prompt=10, reply=4, cached=3, written=2)


@pytest.mark.parametrize(
    ("block", "call"),
    [
        ({"name": "observe", "input": {}}, ("", "observe", "{}")),
        ({"id": None, "name": "observe", "input": {}}, ("", "observe", "{}")),
        ({"id": "a", "name": "observe"}, ("a", "observe", "")),
        ({"id": "a", "input": {}}, ("a", "", "{}")),
        ({"id": "a", "name": "act", "input": None}, ("a", "act", "null")),
    ],
)
def test_a_call_that_lacks_a_part_is_played_like_any_other(block, call):
    """Compatible servers leave out ids and empty arguments; the game has an answer for everything else."""
    (called,) = reply({"content": [{"type": "tool_use", **block}]}).message["tool_calls"]
    assert (called["id"], called["function"]["name"], called["function"]["arguments"]) == call


def test_whatever_a_compatible_server_has_put_into_words_and_usage_is_read():
    usage = {"input_tokens": "many", "output_tokens": 2.0, "cache_read_input_tokens": None, "cache_creation": 7}
    answer = {"content": [{"type": "text", "text": None}, {"type": "text", "text": "Hi"}], "usage": usage}
    assert reply(answer) == sp.Reply({"role": "assistant", "content": "Hi"}, sp.Usage(reply=2))


@pytest.mark.parametrize("action", ["\ud83d", float("inf")])
def test_what_utf_8_or_json_cannot_hold_is_recorded_and_rewritten_in_requests_alone(action):
    function = {"name": "act", "arguments": json.dumps({"action": action})}
    odd = {"role": "assistant", "content": "\ud83d", "tool_calls": [{"id": "a", "function": function}]}
    events: list[dict[str, object]] = []
    episode = sp.Episode("Hanoi3Disk-v0", seed=7, budget=sp.Budget(tool_calls=2), transcript=events)
    stub = AnthropicStub([odd, calling(act("A->C"))])
    with stub, episode, AnthropicPlayer("m", base_url=stub.url, api_key="k", pause=0.0) as player:
        assert sp.play(episode, player).end_reason == "tool_calls"
    words, call = stub.bodies[1]["messages"][1]["content"]
    assert words["text"] == "\ufffd"
    assert call["input"] == ({"action": "\ufffd"} if action == "\ud83d" else {"arguments": function["arguments"]})
    assert next(event for event in events if event["event"] == "message")["message"]["content"] == "\ud83d"


THOUGHT = {"type": "thinking", "thinking": "Hm.", "signature": "s"}
SO = {"type": "text", "text": "So."}


def test_words_that_are_none_are_left_out_beside_thinking_and_have_a_stand_in_elsewhere():
    """The interface refuses words that are empty, and sends them itself."""
    thinking = reply({"content": [THOUGHT, {"type": "text", "text": ""}, SO]}).message
    sent = request(sp.Prompt([{"role": "user", "content": ""}, thinking], ()), cache=False)["messages"]
    assert [message["content"] for message in sent] == [[{"type": "text", "text": "..."}], [THOUGHT, SO]]


def test_a_reply_without_a_cap_of_the_budget_has_the_players_own():
    assert request(sp.Prompt([], ()))["max_tokens"] == 4096


def test_a_missing_key_is_one_sentence(monkeypatch, tmp_path: Path):
    for name in ("ANTHROPIC_API_KEY", "ANTHROPIC_AUTH_TOKEN", "ANTHROPIC_PROFILE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    with pytest.raises(sp.InvalidArgumentError, match="needs a key: set ANTHROPIC_API_KEY"):
        sp.get_player("anthropic:m")
    monkeypatch.setenv("ANTHROPIC_CONFIG_DIR", str(tmp_path))
    with pytest.raises(sp.InvalidArgumentError, match="finds no key: Config file not found"):
        sp.get_player("anthropic:m")


def test_another_choice_of_marks_is_refused():
    with pytest.raises(sp.InvalidArgumentError, match='cache is True, "stable" or False, not 5'):
        AnthropicPlayer("m", api_key="k", cache=5)
