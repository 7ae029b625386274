"""Compactors that do anything: no prompt is over its cap, and a record has all that happened."""

from __future__ import annotations

import asyncio
import json
import random
from pathlib import Path
from typing import Any

import pytest

import smartplay_tools as sp
from smartplay_tools.episode.budgets import refused_strategy
from smartplay_tools.records import replay, resume, sent_prompts
from smartplay_tools.testing import check_strategy
from tests.counting import message_tokens, tools_tokens
from tests.data.any_compactor import GENTLE, MARKER, QUESTIONS, WILD
from tests.scripts import GAMES, Words

ANY = f"{Path(__file__).parent / 'data' / 'any_compactor.py'}:AnyCompactor"
WORDS = (None, "", "He likes Rock.", "word " * 60, "\ud83d\ude00")


def setting(chance: random.Random, number: int, *, pictures: bool) -> dict[str, Any]:
    """Draw a game and a budget, near the smallest prompt, where it has an effect."""
    game = "Crafter-v0" if pictures else chance.choice(GAMES)
    options: dict[str, Any] = {"observation": chance.choice(["both", "picture"])} if pictures else {}
    wild, persistent = (json.dumps(chance.random() < share) for share in (0.3, 0.7))
    while True:
        given: dict[str, Any] = {
            "strategy": f"{ANY}:seed={number}:wild={wild}:persistent={persistent}",
            "history": chance.choice([None, None, 0, 1, 2, 5]),
            "notes_tokens": chance.choice([None, None, 12]),
            "recall_tokens": chance.choice([None, None, 30]),
            "memory_tokens": chance.choice([None, None, 40]),
            "result_tokens": chance.choice([None, 200, 300]),
            "beyond_result": chance.choice(["cut", "cut", "offload"]),
            "newest_pictures": chance.choice([None, 1, 2]) if pictures else None,
            "stalled_turns": chance.choice([None, 6]),
        }
        if refused_strategy(sp.Budget(**given), sp.GAMES[game], context="window", **options) is None:
            break
    options |= {"manual": chance.choice(["tool", "tool", "pinned", "none"]), "tokenizer": Words(), "seed": number}
    with sp.Episode(game, budget=sp.Budget(**given), **options) as episode:
        least = episode.counter.prompt(episode.head, episode.tools) + (200 if pictures else 0)
    given["prompt_tokens"] = chance.choice([None, *(least + more for more in (330, 400, 600, 1000))])
    given["question_tokens"] = chance.choice([None, 40, 200, 4000])
    return {"game": game, "budget": sp.Budget(**given), **options}


def reply(chance: random.Random, prompt: sp.Prompt) -> sp.Message:
    names = [tool.name for tool in prompt.tools] or ["act"]
    texts = {"query": "step 1", "text": "Rock wins", "page": "r1.2", "action": "1", "command": "view"}
    message = sp.call(chance.choice([*["act"] * 4, *names]), say=chance.choice(WORDS), **texts)
    if chance.random() < 0.5:
        message = sp.call("act", say=chance.choice(WORDS), action="1")
    return message if chance.random() < 0.9 else {"role": "assistant", "content": chance.choice(WORDS)}


def judge(conversation: sp.Conversation, prompt: sp.Prompt) -> None:
    """What goes over the wire is within its cap and can be sent; masked results are masked."""
    budget, count = conversation.episode.budget, Words().count
    sizes = {sha256: (picture.width, picture.height) for sha256, picture in conversation.pictures.items()}
    for message in prompt.messages:
        for part in message["content"] if isinstance(message["content"], list) else ():
            assert part["type"] == "text" or (part["width"], part["height"]) == sizes[part["sha256"]]
    schemas = [tool.to_json() for tool in prompt.tools]
    tokens = 3 + sum(message_tokens(message, count) for message in prompt.messages) + tools_tokens(schemas, count)
    assert conversation.view is not None
    assert conversation.view.tokens == tokens
    cap = budget.prompt_tokens
    if prompt.purpose != "play":
        cap = cap if budget.question_tokens is None else budget.question_tokens
        assert any(message.get("tool_calls") for message in prompt.messages) == bool(prompt.tools)
    assert cap is None or tokens <= cap
    assert json.loads(json.dumps(prompt.messages)) == prompt.messages
    waiting: list[str] = []
    seen: set[str] = set()
    for message in prompt.messages:
        if message["role"] == "tool":
            waiting.remove(message["tool_call_id"])
            continue
        assert not waiting
        waiting = [each["id"] for each in message.get("tool_calls", ())]
        assert len({*waiting}) == len(waiting)
        assert seen.isdisjoint(waiting)
        assert all(0 < len(each) <= 64 and each.isascii() for each in waiting)
        seen.update(waiting)
    assert not waiting
    spoken = [message["role"] for message in prompt.messages if message["role"] not in ("system", "developer")]
    assert spoken[-1] != "assistant"
    assert prompt.purpose != "play" or spoken[0] == "user"
    oldest = conversation.view.selection.oldest
    dates = {item.message.get("tool_call_id"): item.date for turn in conversation.turns for item in turn.items}
    for message in prompt.messages:
        if message["role"] == "tool" and (date := dates.get(message["tool_call_id"])) is not None and date < oldest:
            assert message["content"] == MARKER


def played(
    number: int, *, pictures: bool = False, turns: int = 14
) -> tuple[list[Any], list[sp.Prompt], dict[str, Any]]:
    """Play a random episode, judging every prompt; return its record, its prompts and its setting."""
    chance = random.Random(f"compaction {number}")
    given, events, prompts = setting(chance, number, pictures=pictures), list[Any](), list[sp.Prompt]()
    with sp.Episode(**given, transcript=events) as episode:
        conversation = sp.Conversation(episode)
        while episode.stats.turns < turns and (prompt := conversation.prompt()) is not None:
            prompts.append(prompt)
            judge(conversation, prompt)
            answer: sp.Message = {"role": "assistant", "content": chance.choice(WORDS)}
            conversation.receive(answer if prompt.purpose != "play" else reply(chance, prompt))
    return json.loads(json.dumps(events)), prompts, given


def check(number: int, *, pictures: bool = False, everywhere: bool = False, resumed: bool = True) -> int:
    """Play an episode, and require all that a record promises; return the number of its prompts.

    Every third is replayed with its compactor. It is resumed at its middle, `everywhere` at every event, or not at all.
    """
    events, prompts, given = played(number, pictures=pictures)
    rebuilt = list(sent_prompts(events))
    assert [sent.prompt.messages for sent in rebuilt] == [prompt.messages for prompt in prompts]
    assert [sent.prompt.tools for sent in rebuilt] == [prompt.tools for prompt in prompts]
    assert all(sent.sha256 == sent.recorded_sha256 for sent in rebuilt)
    tokenizer = {"tokenizer": given["tokenizer"]}
    assert replay(events, **tokenizer, calls_compactor=number % 3 == 0).differences == []
    if not resumed:
        return len(prompts)
    ends = events[:-1] if events[-1]["event"] == "end" else events
    places = range(2, len(ends)) if everywhere else [1 + len(ends) // 2]
    for at in places:
        with resume(events[:at], transcript=(again := []), **tokenizer) as episode:  # type: ignore[arg-type]
            assert episode.conversation is not None
            episode.conversation.prompt()
        kept = [event for event in again if event["event"] not in ("resume", "end")]
        for was, now in zip(ends, kept, strict=False):
            assert {**was, "chain": ""} == {**json.loads(json.dumps(now)), "chain": ""}
    return len(prompts)


def test_every_kind_of_rewriting_and_of_question_is_drawn():
    assert (len(GENTLE) + len(WILD), len(QUESTIONS)) == (44, 7)


def test_whatever_a_compactor_does_no_prompt_is_over_its_cap_and_the_record_has_all_of_it():
    assert sum(check(number) for number in range(20)) > 100


def test_a_result_whose_picture_was_left_out_is_masked_later():
    assert check(2_000_400, pictures=True) > 10


@pytest.mark.slow
@pytest.mark.parametrize("part", range(2))
def test_the_same_in_eight_thousand_prompts(part):
    prompts, number = 0, 1_000_000 * (part + 1)
    while prompts < 4_000:
        prompts += check(number, pictures=number % 50 == 0, everywhere=number % 200 == 0, resumed=number % 5 < 2)
        number += 1


@pytest.mark.slow
@pytest.mark.parametrize("number", range(60))
def test_an_episode_on_an_event_loop_is_the_same(number):
    events, _, given = played(number)
    replies = [e["message"] if e["event"] == "message" else e["reply"] for e in events if _is_reply(e)]
    again: list[Any] = []
    with sp.Episode(**given, transcript=again) as episode:
        asyncio.run(sp.aplay(episode, sp.ScriptedPlayer(replies)))
    events = [event for event in events if event["event"] not in ("start", "end")]
    for was, now in zip(events, again[1:], strict=False):
        assert {**was, "chain": ""} == {**json.loads(json.dumps(now)), "chain": ""}


def _is_reply(event: Any) -> bool:
    return event.get("by") == "player" or (event["event"] == "question" and event["reply"] is not None)


@pytest.mark.slow
def test_processes_play_alike():
    for seed in range(3):
        check_strategy(f"{ANY}:seed={seed}", episodes=20)
