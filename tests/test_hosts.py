"""What a host that owns the context has sent is counted and put on record, and none of it is enforced."""

from __future__ import annotations

import asyncio

import pytest

import smartplay_tools as sp
from smartplay_tools.context.tokens.counter import shared_counter
from smartplay_tools.players import NotedPlayer
from smartplay_tools.records import Record, replay
from smartplay_tools.transcript.hashing import head_bytes, prompt_sha256, tools_bytes

BANDIT = "BanditTwoArmedHighLowFixed-v0"


def ask(noted: NotedPlayer, prompt: sp.Prompt) -> sp.Message:
    return asyncio.run(noted.areply(prompt)).message


def play(events: list, budget: sp.Budget, turns: int) -> tuple[list[sp.Prompt], sp.EpisodeResult]:
    """A host that shows its model everything, for some turns."""
    prompts = []
    with sp.Episode(BANDIT, seed=1, context="host", budget=budget, transcript=events) as episode:
        noted = NotedPlayer(sp.get_player("rule"), episode)
        messages = list(episode.head)
        for _ in range(turns):
            prompts.append(sp.Prompt([*messages], episode.tools))
            reply = ask(noted, prompts[-1])
            messages.append(reply)
            for call in reply["tool_calls"]:
                result = episode.call(call["function"]["name"], call["function"]["arguments"])
                messages.append({"role": "tool", "tool_call_id": call["id"], "content": result.text})
        episode.end("host")
        assert episode.result is not None
        return prompts, episode.result


def test_every_prompt_is_counted_and_on_record():
    events: list = []
    prompts, result = play(events, sp.Budget(), turns=5)
    record, counter = Record(events), shared_counter()
    assert [event["tokens"] for event in record.sent] == [counter.prompt(p.messages, p.tools) for p in prompts]
    assert [event["sha256"] for event in record.sent] == [
        prompt_sha256(map(head_bytes, p.messages), tools_bytes(p.tools)) for p in prompts
    ]
    assert [event["turn"] for event in record.sent] == [0, 1, 2, 3, 4]
    assert result.tokens.prompt == sum(event["tokens"] for event in record.sent)
    assert result.tokens.reply == sum(event["reply"] for event in record.sent)
    assert record.peak_prompt_tokens == record.sent[-1]["tokens"]
    assert "over_prompts" not in result.model_dump()
    assert replay(events).identical


def test_a_prompt_over_the_cap_is_counted_and_not_cut():
    events: list = []
    whole, _ = play([], sp.Budget(), turns=4)
    cap = shared_counter().prompt(whole[1].messages, whole[1].tools)
    prompts, result = play(events, sp.Budget(prompt_tokens=cap), turns=4)
    assert len(prompts) == 4
    assert [event["over"] for event in Record(events).sent] == [False, False, True, True]
    assert result.over_prompts == 2
    assert replay(events).identical


def test_a_window_notes_its_own_prompts():
    with sp.Episode(BANDIT, seed=1) as episode:
        noted = NotedPlayer(sp.get_player("rule"), episode)
        with pytest.raises(sp.InvalidArgumentError, match='context="host" only'):
            ask(noted, sp.Prompt(episode.head, episode.tools))


def test_after_the_end_nothing_is_noted():
    events: list = []
    prompts, _ = play(events, sp.Budget(), turns=1)
    with sp.Episode(BANDIT, seed=1, context="host", transcript=(own := [])) as episode:
        episode.end("host")
        ask(NotedPlayer(sp.get_player("rule"), episode), prompts[0])
    assert not Record(own).sent


def test_a_host_that_asks_for_a_summary_in_its_own_words_gets_the_newest_notes():
    asked = (
        'Summarize:\n<message type="ai">Notes: {"clock":1,"machines":{}}</message> AI: Notes: {"clock":3,"machines":{}}'
    )
    reply = sp.get_player("rule-notes").reply(sp.Prompt([{"role": "user", "content": asked}], ()))
    assert reply.message["content"] == 'Notes: {"clock":3,"machines":{}}'
    other = sp.get_player("rule-notes").reply(sp.Prompt([{"role": "user", "content": "A title, please."}], ()))
    assert "no tool `act`" in other.message["content"]
