"""A host changes its instructions and tools during an episode: prompts follow, the record says so and replays."""

from __future__ import annotations

import pytest

import smartplay_tools as sp
from smartplay_tools.context.tokens import TokenCounter
from smartplay_tools.records.prompts import sent_prompts
from tests.adapters.conformance import act, calling

SEARCH = sp.ToolSpec("search", "Search the web.", {"type": "object", "properties": {}, "additionalProperties": False})


def session_of(budget: sp.Budget | None = None) -> tuple[sp.AgentSession, list]:
    events: list = []
    episode = sp.Episode("Hanoi3Disk-v0", seed=7, budget=budget, transcript=events)
    return sp.AgentSession(episode, head=[{"role": "system", "content": "Be quick."}]), events


def play_turn(session: sp.AgentSession, reply: sp.Message) -> sp.Prompt:
    prompt = session.prompt()
    for call in session.receive(reply):
        session.answer(call.id)
    return prompt


def test_prompts_follow_and_the_record_replays():
    session, events = session_of()
    with session.episode:
        first = play_turn(session, calling(act("A->C")))
        session.change_head([{"role": "system", "content": "Be careful."}], [SEARCH])
        second = play_turn(session, calling(act("A->B")))
        session.change_head([{"role": "system", "content": "Be careful."}], [SEARCH])
        third = play_turn(session, calling(act("C->B")))
    heads = [event for event in events if event["event"] == "head"]
    assert len(heads) == 2, "the same head again is not a change"
    prefixes = [event["prefix_tokens"] for event in events if event["event"] == "view"]
    assert [head.get("since") for head in heads] == [None, 1]
    assert prefixes[:2] == [0, 0], "no prompt begins with other tools"
    assert prefixes[2] > 0
    assert [prompt.messages[2]["content"] for prompt in (first, second, third)] == ["Be quick."] + ["Be careful."] * 2
    assert [len(prompt.tools) for prompt in (first, second, third)] == [3, 4, 4]
    assert all(sent.sha256 == sent.recorded_sha256 for sent in sent_prompts(events))
    assert [sent.prompt.messages for sent in sent_prompts(events)] == [p.messages for p in (first, second, third)]
    assert sp.replay(events).identical


def test_a_longer_head_is_counted_and_leaves_less_room():
    session, events = session_of(sp.Budget(prompt_tokens=800))
    counter = TokenCounter()
    with session.episode:
        for move in ("A->B", "B->A") * 6:
            play_turn(session, calling(act(move)))
        session.change_head([{"role": "system", "content": "Think of the Hanoi rules. " * 20}], [])
        for move in ("A->B", "B->A") * 3:
            prompt = play_turn(session, calling(act(move)))
            assert counter.prompt(prompt.messages, prompt.tools) <= 800
        with pytest.raises(sp.InvalidArgumentError, match="prompt_tokens"):
            session.change_head([{"role": "system", "content": "words " * 900}], [])
    views = [event for event in events if event["event"] == "view"]
    counted = [counter.prompt(sent.prompt.messages, sent.prompt.tools) for sent in sent_prompts(events)]
    assert counted == [view["tokens"] for view in views]
    assert sp.replay(events).identical


def test_a_prompt_that_was_made_keeps_its_head():
    session, _ = session_of()
    with session.episode:
        session.prompt()
        assert session.awaits_reply
        with pytest.raises(sp.InvalidArgumentError, match="next prompt"):
            session.change_head([], [])


def test_an_episode_that_is_closed_after_a_failed_attempt_ends_as_player_error():
    session, events = session_of()
    with session.episode:
        session.prompt()
        session.fail(ConnectionError("no route to host"))
    assert session.result.end_reason == "player_error"
    assert session.result.error == "ConnectionError: no route to host"
    assert "ConnectionError" in events[-1]["traceback"]
    assert sp.replay(events).identical


def test_an_episode_that_is_closed_after_a_limit_of_the_host_ends_as_host():
    session, events = session_of()
    with session.episode:
        play_turn(session, calling(act("A->C")))
        session.halt("tool call limit")
    assert (session.result.end_reason, session.result.detail) == ("host", "tool call limit")
    assert sp.replay(events).identical
