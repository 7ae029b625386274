"""The work of a call and a prompt: arguments are parsed once, messages encoded once, and copied when they are read."""

from __future__ import annotations

import json
from collections import Counter

import pytest

import smartplay_tools as sp
from smartplay_tools.context import turns
from smartplay_tools.context.tokens import TokenCounter
from smartplay_tools.types import arguments, prompt

RPS = "RockPaperScissorBasic-v0"


@pytest.fixture
def counted(monkeypatch):
    """How often texts are parsed, and messages encoded and copied."""
    counts: Counter[str] = Counter()

    def count(owner, name, what):
        original = getattr(owner, name)

        def counting(*arguments, **keywords):
            counts[what] += 1
            return original(*arguments, **keywords)

        monkeypatch.setattr(owner, name, counting)

    count(arguments, "parse", "parsed")
    count(turns, "message_bytes", "encoded")
    count(prompt, "copy_of", "copied")
    return counts


def test_of_a_turn(counted):
    with sp.Episode(RPS, seed=1, tokenizer="approximate") as episode:
        conversation = sp.Conversation(episode)
        for number in range(30):
            sent = {"action": "1", "why": number} if number % 2 else {"action": "1"}
            call = {"id": f"{number}", "function": {"name": "act", "arguments": json.dumps(sent)}}
            conversation.prompt()
            counted.clear()
            conversation.receive({"role": "assistant", "content": None, "tool_calls": [call]})
            # Arguments that came before are not parsed again.
            assert counted == ({"parsed": 1} if "why" in sent else {}) or number == 0
            counted.clear()
            prompt = conversation.prompt()
            assert counted == {}, "nothing is parsed, and nothing is copied before it is read"
            shown = len(prompt.messages)
            assert len(prompt.messages) == shown == counted["copied"], "every message is copied once"


def test_a_reply_is_counted_once(monkeypatch):
    counted, count = [], TokenCounter.message
    monkeypatch.setattr(TokenCounter, "message", lambda *given: counted.append(given[1]["role"]) or count(*given))
    with sp.Episode(RPS, seed=1, tokenizer="approximate") as episode:
        conversation = sp.Conversation(episode)
        conversation.prompt()
        counted.clear()
        conversation.receive(sp.call("act", action="1"))
        conversation.prompt()
    assert counted == ["assistant", "tool"]


def test_of_a_turn_that_is_recorded(counted, tmp_path):
    with sp.Episode(RPS, seed=1, tokenizer="approximate", transcript=tmp_path / "record.jsonl") as episode:
        conversation = sp.Conversation(episode)
        conversation.prompt()
        for number in range(30):
            call = {"id": f"{number}", "function": {"name": "act", "arguments": '{"action": "1"}'}}
            counted.clear()
            conversation.receive({"role": "assistant", "content": None, "tool_calls": [call]})
            conversation.prompt()
            assert counted["parsed"] <= 1
            assert counted["encoded"] == 2, "the reply and its result, and nothing that was shown before"
