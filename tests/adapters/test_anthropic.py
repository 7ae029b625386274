"""Anthropic: what a request holds, what an answer becomes, and what happens when the server is busy."""

from __future__ import annotations

import anthropic
import pytest
from smartplay_anthropic import AnthropicPlayer, reply, request

import smartplay_tools as sp
from tests.adapters.anthropic_stub import AnthropicStub
from tests.adapters.conformance import act, calling, fresh


@pytest.fixture(autouse=True)
def _no_proxy(monkeypatch):
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")


def play(stub: AnthropicStub, budget: sp.Budget, **options: object) -> sp.EpisodeResult:
    episode, _ = fresh(budget)
    with stub, episode, AnthropicPlayer("m", base_url=stub.url, api_key="k", pause=0.0, **options) as player:
        return sp.play(episode, player)


def test_the_usage_adds_up_what_the_interface_counts_apart():
    result = play(AnthropicStub([calling(act("A->C"))]), sp.Budget(tool_calls=1))
    assert result.tokens.provider == sp.Usage(prompt=10, reply=4, cached=3)


def test_a_busy_server_is_asked_again_and_each_attempt_counts():
    result = play(AnthropicStub([calling(act("A->C"))], faults=[529, 500]), sp.Budget(tool_calls=1))
    assert result.tokens.provider.requests == 3


@pytest.mark.parametrize(("faults", "options"), [([400], {}), ([529, 529], {"retries": 1})])
def test_a_server_that_refuses_ends_the_episode_on_the_record(faults, options):
    result = play(AnthropicStub([], faults=faults), sp.Budget(), **options)
    assert result.end_reason == "player_error"


def test_thinking_goes_back_with_its_turn_and_is_counted():
    thinking = {"type": "thinking", "thinking": "Hm, hm.", "signature": "s1"}
    stub = AnthropicStub([calling(act("A->C"), say="So."), calling(act("A->B"))], extra=[thinking])
    result = play(stub, sp.Budget(tool_calls=2))
    assert stub.bodies[1]["messages"][1]["content"][:2] == [thinking, {"type": "text", "text": "So."}]
    plain = play(AnthropicStub([calling(act("A->C"), say="So."), calling(act("A->B"))]), sp.Budget(tool_calls=2))
    assert result.tokens.reply > plain.tokens.reply


def test_the_cap_on_a_reply_is_the_budgets():
    stub = AnthropicStub([calling(act("A->C"))])
    play(stub, sp.Budget(tool_calls=1, reply_tokens=77))
    assert stub.bodies[0]["max_tokens"] == 77
    assert request(sp.Prompt([], ()))["max_tokens"] == 4096


def test_words_that_are_none_and_names_that_cannot_be_do_no_harm():
    odd = calling(("go north!", "{"))
    result = {"role": "tool", "tool_call_id": "c0", "content": "Error"}
    sent = request(sp.Prompt([{"role": "user", "content": ""}, odd, result, calling()], ()))["messages"]
    assert sent[0]["content"] == [{"type": "text", "text": "..."}]
    assert sent[1]["content"] == [{"type": "tool_use", "id": "c0", "name": "go_north_", "input": {"arguments": "{"}}]
    assert sent[3]["content"] == [{"type": "text", "text": "..."}]


def test_an_answer_of_the_client_and_its_json_are_the_same():
    answer = {
        "id": "m",
        "type": "message",
        "role": "assistant",
        "model": "m",
        "content": [{"type": "text", "text": "Hi"}],
        "stop_reason": "end_turn",
        "stop_sequence": None,
        "usage": {"input_tokens": 1, "output_tokens": 2},
    }
    assert reply(answer) == reply(anthropic.types.Message.model_validate(answer))
    assert reply(answer).message == {"role": "assistant", "content": "Hi"}


def test_the_player_needs_a_model():
    with pytest.raises(sp.InvalidArgumentError, match="anthropic:MODEL"):
        sp.get_player("anthropic")
