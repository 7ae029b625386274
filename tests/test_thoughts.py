"""Old replies without their words: what is shown, counted and on record, with and without slack."""

from __future__ import annotations

import smartplay_tools as sp
from smartplay_tools.types.messages import function_call
from tests import scripts

RPS = "RockPaperScissorDifferentScore-v0"


def speaking(words, *calls, **more):
    made = [function_call(f"c{at}", *call) for at, call in enumerate(calls)]
    return {"role": "assistant", "content": words, **more, **({"tool_calls": made} if made else {})}


ROCK = ("act", '{"action": "Rock"}')


def played(replies, **budget):
    events = []
    with sp.Episode(RPS, seed=1, budget=sp.Budget(history=None, **budget), transcript=events) as episode:
        conversation = sp.Conversation(episode)
        prompts = []
        for reply in replies:
            conversation.receive(reply)
            prompt = conversation.prompt()
            prompts.append([message for message in prompt.messages if message["role"] == "assistant"])
    return prompts, scripts.as_json(events)


def test_words_reasoning_and_items_leave_and_calls_and_names_stay():
    item = {"type": "reasoning", "summary": [{"type": "summary_text", "text": "Hm."}]}
    first = speaking("I think.", ROCK, name="me", reasoning_content="Why not?", provider_items=[item])
    prompts, _ = played([first, speaking("Two.", ROCK), speaking("Three.", ROCK)], own_words=1)
    assert prompts[1][0]["reasoning_content"] == "Why not?"
    bare = prompts[2][0]
    assert set(bare) == {"role", "name", "content", "tool_calls"}
    assert (bare["content"], bare["name"]) == (None, "me")
    assert bare["tool_calls"] == prompts[1][0]["tool_calls"]


def test_with_slack_words_leave_in_blocks():
    prompts, _ = played([speaking(f"{at}", ROCK) for at in range(9)], own_words=4, slack=0.5)
    kept = [sum(reply["content"] is not None for reply in shown) for shown in prompts]
    assert kept == [1, 2, 3, 4, 3, 4, 5, 3, 4]


def test_it_costs_nothing_where_it_is_off():
    _, events = played([speaking("One.", ROCK)] * 3)
    assert "own_words" not in str(events)
    assert "words" not in events[-2]
