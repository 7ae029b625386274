"""The fields of a reply: a stream gives the reply of the whole answer, however it is cut, and all of it goes back."""

from __future__ import annotations

import contextlib
import json
import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from smartplay_anthropic.codec import reply as blocks_reply

import smartplay_tools as sp
from smartplay_tools.players import BrokenAnswerError
from smartplay_tools.players.wire.chat import CHAT
from smartplay_tools.players.wire.responses import RESPONSES
from smartplay_tools.providers.reply_fields import NOT_COUNTED
from smartplay_tools.types.messages import assistant_message, calls_of, reasoning_of, text_of
from tests.dialects.rules import DIALECTS
from tests.dialects.said import Said
from tests.dialects.server import in_pieces, whole_answer

DOCS = Path(__file__).parents[2] / "docs" / "openai.md"
WORDS = ["I", " go", " now", "\u00e9", "\U0001f600", ".", "\n", '"', "{"]
ROCK = {"action": "Rock"}


def words(rng: random.Random) -> str:
    return "".join(rng.choices(WORDS, k=rng.randrange(1, 9)))


def pieces(rng: random.Random, text: str) -> list[str]:
    """A text in pieces, some of them empty, as servers send them."""
    cuts = sorted(rng.choices(range(len(text) + 1), k=rng.randrange(4)))
    return [text[a:b] for a, b in zip([0, *cuts], [*cuts, len(text)], strict=True)]


def stream(*deltas: dict[str, Any]) -> list[dict[str, Any]]:
    """A stream that says these deltas and ends with calls of tools."""
    sent = [{"choices": [{"index": 0, "delta": delta, "finish_reason": None}]} for delta in deltas]
    return [*sent, {"choices": [{"index": 0, "delta": {}, "finish_reason": "tool_calls"}]}]


def piece(arguments: Any, **beside: Any) -> dict[str, Any]:
    """A piece of a call."""
    named = {"name": beside.pop("name")} if "name" in beside else {}
    return {"tool_calls": [{**beside, "function": {**named, "arguments": arguments}}]}


ROCKS = [{"id": f"c{number}", "name": "act"} for number in range(2)]
HALVES = json.dumps(ROCK)[:9], json.dumps(ROCK)[9:]
TWO_CALLS: dict[str, list[dict[str, Any]]] = {
    "whole": [piece(json.dumps(ROCK), index=at, **rock) for at, rock in enumerate(ROCKS)],
    "in pieces": [piece(half, index=at, **rock) for at, rock in enumerate(ROCKS) for half in HALVES],
    "from the last": [piece(half, index=at, **ROCKS[at]) for at in (1, 0) for half in HALVES],
    "interleaved": [piece(half, index=at, **rock) for half in HALVES for at, rock in enumerate(ROCKS)],
    "all at index 0": [piece(half, index=0, **rock) for rock in ROCKS for half in HALVES],
    "without an index": [piece(half, **rock) for rock in ROCKS for half in HALVES],
    "as objects": [piece(ROCK, index=at, **rock) for at, rock in enumerate(ROCKS)],
    "whole again at the end": [
        piece(text, index=at, **rock) for at, rock in enumerate(ROCKS) for text in (*HALVES, json.dumps(ROCK))
    ],
    "counted on": [
        each
        for at, rock in enumerate(ROCKS)
        for each in (piece(HALVES[0], index=at, **rock), piece(HALVES[1], index=9))
    ],
}
"""Two calls with the same arguments, as servers cut them; `tests/dialects` has those of one server each."""


@pytest.mark.parametrize("cut", TWO_CALLS)
@pytest.mark.parametrize("first", [[], [{"choices": [], "usage": {"prompt_tokens": 9}}]])
def test_calls_are_put_together_however_they_are_cut(cut, first):
    reply = CHAT.reply(CHAT.assemble([*first, *stream(*TWO_CALLS[cut])]))
    calls = [(call["id"], call["function"]["name"], call["function"]["arguments"]) for call in calls_of(reply.message)]
    assert sorted(calls) == [(rock["id"], rock["name"], json.dumps(ROCK)) for rock in ROCKS]


def item_pieces(rng: random.Random, item: dict[str, Any]) -> list[dict[str, Any]]:
    """The events of an item between its first and its last: in pieces, and whole in one that may be missing."""
    if "arguments" in item:
        what, field, text, place = "function_call_arguments", "arguments", item["arguments"], {}
    elif "content" in item:
        what, field, text = "output_text", "text", item["content"][0]["text"]
        place = {"content_index": 0}
    else:
        return []
    cut = [{"type": f"{what}.delta", "delta": piece, **place} for piece in pieces(rng, text)]
    again = [{"type": f"{what}.delta", "delta": text}] if field == "arguments" and rng.random() < 0.3 else []
    return [*cut, *again, *rng.choice([[], [{"type": f"{what}.done", field: text, **place}]])]


def response(rng: random.Random) -> tuple[dict[str, Any], list[Any]]:
    """A whole response, and the events of its stream."""
    items: list[dict[str, Any]] = [
        {"type": "reasoning", "id": "r", "summary": [{"type": "summary_text", "text": words(rng)}]}
    ]
    items += [{"type": "message", "id": "m", "content": [{"type": "output_text", "text": words(rng)}]}]
    for number in range(rng.randrange(3)):
        items.append({"type": "function_call", "call_id": f"c{number}", "name": "act", "arguments": json.dumps(ROCK)})
    whole = {"status": "completed", "output": items, "usage": {"input_tokens": 9, "output_tokens": 5}}
    events: list[dict[str, Any]] = []
    has_done, has_index = rng.choice([(True, True), (True, False), (False, True)])
    for at, item in enumerate(items):
        empty = {"content": []} if "content" in item else {"arguments": ""} if "arguments" in item else {}
        said = [{"type": "output_item.added", "item": {**item, **empty}}, *item_pieces(rng, item)]
        said += [{"type": "output_item.done", "item": item}] if has_done else []
        index = {"output_index": at} if has_index else {}
        events += [{**event, **index, "type": f"response.{event['type']}"} for event in said]
    if has_done and has_index:
        rng.shuffle(events)
    ended = {**whole, **rng.choice([{}, {"output": []}, {"output": None}])}
    events.append({"type": "response.completed", "response": ended})
    return whole, events


def compare_responses(seed: int) -> None:
    whole, events = response(random.Random(seed))
    assert RESPONSES.reply(RESPONSES.assemble(events)) == RESPONSES.reply(whole), seed


@pytest.mark.parametrize("seeds", [range(70), pytest.param(range(70, 1_400), marks=pytest.mark.slow)])
def test_a_stream_of_responses_gives_the_reply_of_the_whole_answer(seeds):
    for seed in seeds:
        compare_responses(seed)


HALF = {"index": 0, "id": "c", "function": {"name": "act", "arguments": '{"action": "Ro'}}
USAGE: dict[str, Any] = {"choices": [], "usage": {"prompt_tokens": 9}}


@pytest.mark.parametrize("delta", [{"tool_calls": [HALF]}, {"content": "I"}])
@pytest.mark.parametrize("first", [[], [USAGE]])
def test_a_stream_that_was_cut_is_no_reply(delta, first):
    """Without a finish reason, words and calls whose arguments are not whole may go on; usage before ends none."""
    with pytest.raises(BrokenAnswerError, match="ended before the reply did"):
        CHAT.assemble([*first, {"choices": [{"delta": delta}]}])
    items = [{"type": "response.output_item.done", "item": {"type": "message"}}]
    items += [{"type": "response.output_item.added", "item": {"type": "function_call", "name": "act"}}]
    with pytest.raises(BrokenAnswerError, match="ended before the reply did"):
        RESPONSES.assemble(items)


def test_a_stream_whose_calls_are_whole_needs_no_end():
    whole = {**HALF, "function": {"name": "act", "arguments": json.dumps(ROCK)}}
    item = {"type": "function_call", "call_id": "c", "name": "act", "arguments": json.dumps(ROCK)}
    chat = CHAT.assemble([{"choices": [{"delta": {"tool_calls": [whole]}}]}])
    responses = RESPONSES.assemble([{"type": "response.output_item.done", "item": item}])
    assert calls_of(CHAT.reply(chat).message) == calls_of(RESPONSES.reply(responses).message) != ()


def test_what_a_model_says_twice_stays_its_mistake():
    twice = json.dumps(ROCK) * 2
    deltas = [
        {"index": 0, "id": "c", "function": {"name": "act", "arguments": piece}} for piece in (twice[:9], twice[9:])
    ]
    chunks = [{"choices": [{"delta": {"tool_calls": [delta]}, "finish_reason": "tool_calls"}]} for delta in deltas]
    (call,) = calls_of(CHAT.reply(CHAT.assemble(chunks)).message)
    assert call["function"]["arguments"] == twice


@pytest.mark.parametrize("odd", [7, "x", {"a": 1}, [7], [None], [{"delta": 7}], [{"delta": {"tool_calls": 7}}]])
def test_chunks_of_another_shape_are_a_broken_answer(odd):
    with pytest.raises(BrokenAnswerError):
        CHAT.assemble([{"choices": odd}])


SIGNED = [{"type": "reasoning.text", "text": "Hm.", "signature": "S", "index": 0}]
ODD: list[Any] = [None, True, 0, "", [], {}, [None], [["x"]], {"type": "x"}, {"type": [None]}, [{"type": {"x": 1}}]]


OPENROUTER = DIALECTS["OpenRouter"]
ANSWER = whole_answer(OPENROUTER, Said(words="I go.", thoughts="Hm.", calls=(("act", json.dumps(ROCK)),)), 1)


def with_odd_values(value: Any) -> Iterator[Any]:
    """Copies of JSON data, each with a value of another kind in one place."""
    yield from ODD
    keys = value if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ()
    for key in keys:
        for odd in with_odd_values(value[key]):
            changed = value.copy()
            changed[key] = odd
            yield changed


def test_a_reply_with_values_of_another_kind_is_read_or_broken():
    whole = CHAT.reply(ANSWER).message
    parts = {
        "reasoning_details": SIGNED,
        "thinking_blocks": [{"type": "thinking", "thinking": [{"type": "text", "text": "Hm."}]}],
        "provider_items": [{"type": "reasoning", "summary": [{"type": "text", "text": "Hm."}], "redacted": True}],
    }
    for changed in with_odd_values({**whole, **parts}):
        if isinstance(changed, dict) and changed.get("role") == "assistant":
            with contextlib.suppress(sp.InvalidArgumentError):
                assert isinstance(reasoning_of(assistant_message(changed)), str)


def test_a_stream_with_values_of_another_kind_is_read_or_broken():
    chunks = [chunk for chunk in in_pieces(OPENROUTER, ANSWER, 5) if isinstance(chunk, dict)]
    for interface, events in ((CHAT, chunks), (RESPONSES, response(random.Random(5))[1])):
        for changed in with_odd_values(events):
            with contextlib.suppress(BrokenAnswerError):
                interface.reply(interface.assemble(changed if isinstance(changed, list) else [changed]))


def back(fields: dict[str, Any]) -> dict[str, Any]:
    """A message as it goes back to the server that said it."""
    message = {**sp.call("act", **ROCK), **fields}
    reply = CHAT.reply({"choices": [{"message": message, "finish_reason": "tool_calls"}]})
    with sp.Episode("RockPaperScissorBasic-v0", seed=1) as episode:
        conversation = sp.Conversation(episode)
        conversation.prompt()
        conversation.receive(reply.message)
        sent = CHAT.request(conversation.prompt())["messages"]
    return next(message for message in sent if message["role"] == "assistant")


@pytest.mark.parametrize(
    "fields",
    [
        {"reasoning": "Hm."},
        {"reasoning": ""},
        {"reasoning_content": "Hm."},
        {"reasoning_content": ""},
        {"reasoning_content": "Hm.", "reasoning": "Hm."},
        {"reasoning": "Hm.", "reasoning_details": SIGNED},
        {"reasoning": [{"type": "text", "text": "Hm."}]},
        {"thinking_blocks": [{"type": "thinking", "thinking": "Hm.", "signature": "S"}]},
        {"content": [{"type": "thinking", "thinking": [{"type": "text", "text": "Hm."}]}]},
        {"content": [{"type": "reasoning", "summary": [{"type": "summary_text", "text": "Hm.", "signature": "S"}]}]},
        {"content": [{"type": "redacted_thinking", "data": "E"}, {"type": "text", "text": "I play."}]},
        {
            "content": [
                {"type": "text", "text": "I"},
                {"type": "reference", "ids": [1]},
                {"type": "text", "text": "play"},
            ]
        },
        {"content": [{"type": "tool_use", "id": "c", "name": "act", "input": {}}, {"odd": 1}]},
        {"content": [{"type": "thought", "text": "Hm.", "at": 3}]},
        {"x": {"y": "Hm.", "z": False}, "is_final": False},
    ],
)
def test_a_thought_goes_back_under_the_name_under_which_it_came(fields):
    sent = back(fields)
    assert {name: sent[name] for name in fields} == fields
    assert sent.keys() == {"role", "content", "tool_calls", *fields}


def test_parts_that_are_no_words_are_counted_as_far_as_they_can_be_read():
    parts = [{"type": "reasoning", "summary": [{"text": "Hm."}]}, {"type": "redacted_thinking", "data": "E"}]
    said = {"content": [*parts, {"type": "reference", "title": "A page"}, {"type": "text", "text": "I play."}]}
    message = CHAT.reply({"choices": [{"message": said}]}).message
    assert (text_of(message), reasoning_of(message)) == ("I play.", "Hm.A page")
    assert CHAT.reply({"choices": [{"message": {"content": {"type": "text", "text": "I play."}}}]}).message["content"]


def test_pieces_of_thoughts_in_a_streamed_content_become_one_part():
    def piece(**summary):
        part = {"type": "reasoning", "summary": [{"type": "summary_text", **summary}]}
        return {"choices": [{"delta": {"content": [part]}}]}

    chunks = [piece(text="Ro"), piece(text="ck."), piece(text="", signature="S")]
    chunks += [{"choices": [{"delta": {"content": "I play."}, "finish_reason": "stop"}]}]
    message = CHAT.assemble(chunks)["choices"][0]["message"]
    whole = [{"type": "summary_text", "text": "Rock.", "signature": "S"}]
    assert message["content"] == [{"type": "reasoning", "summary": whole}, {"type": "text", "text": "I play."}]


@pytest.mark.parametrize("output", [None, []])
def test_an_answer_that_has_an_end_and_nothing_else_is_an_empty_reply(output):
    chat = CHAT.reply({"choices": [{"finish_reason": "length"}], "usage": {"total_tokens": 590, "prompt_tokens": 90}})
    item = {"status": "incomplete", "output": output, "incomplete_details": {"reason": "max_output_tokens"}}
    for reply in (chat, RESPONSES.reply(item), blocks_reply({"content": output, "stop_reason": "max_tokens"})):
        assert (text_of(reply.message), reply.usage.cut) == ("", 1)
    assert chat.usage.reply == 500


@pytest.mark.parametrize("sent", [{"encrypted_content": None}, {"summary": [{"type": "summary_text", "text": "Hm."}]}])
def test_thoughts_that_nobody_could_read_do_not_go_back(sent):
    thought = {"type": "reasoning", "id": "rs_1", "status": "completed", "summary": [], "content": None, **sent}
    call = {"type": "function_call", "id": "fc_1", "call_id": "c", "name": "act", "arguments": "{}"}
    items = [thought, {**thought, "encrypted_content": "E"}, call]
    sent_back = RESPONSES.conversation(sp.Prompt([RESPONSES.reply({"output": items}).message]), mark=False)["input"]
    kept = {name: thought[name] for name in ("type", "id", "summary")}
    assert sent_back == [{**kept, "encrypted_content": "E"}, call]


def test_what_no_provider_takes_back_is_a_mistake_and_goes_back_shortened():
    calls = [{"id": f"c{at}", "function": {"name": "observe", "arguments": "{}"}} for at in range(150)]
    endless = {"id": "e", "function": {"name": "act", "arguments": '{"action": "' + "\\" * 1_100_000}}
    with sp.Episode("RockPaperScissorBasic-v0", seed=1) as episode:
        conversation = sp.Conversation(episode)
        for message in ({"tool_calls": calls}, {"tool_calls": [endless]}, {"content": "word " * 2_200_000}):
            conversation.prompt()
            conversation.receive({"role": "assistant", "content": None, **message})
        prompt = conversation.prompt()
        assert (episode.stats.malformed_calls, episode.stats.tool_calls) == (23, 151)
    for request in (CHAT.request(prompt)["messages"], RESPONSES.request(prompt)["input"]):
        sent = json.dumps(request)
        assert (sent.count('"c127"'), sent.count('"c128"')) == (2, 0)
        assert sent.count("[shortened: ") == 2
    messages = CHAT.request(prompt)["messages"]
    arguments = next(m["tool_calls"] for m in messages if len(m.get("tool_calls", ())) == 1)[0]["function"]["arguments"]
    assert json.loads(arguments)
    assert len(arguments) <= 1_048_576
    assert max(len(m["content"] or "") for m in messages) <= 10_485_760


def test_fields_that_requests_must_not_have_stay_away():
    unsent = {"annotations": [{"type": "url_citation"}], "audio": {"id": "a"}, "function_call": {"name": "act"}}
    assert back({**unsent, "refusal": None, "reasoning": None}).keys() == {"role", "content", "tool_calls"}


def test_the_page_names_what_is_not_counted():
    text = DOCS.read_text(encoding="utf-8")
    assert ", ".join(f"`{name}`" for name in sorted(NOT_COUNTED)) in " ".join(text.split())
