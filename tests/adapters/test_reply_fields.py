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

DOCS = Path(__file__).parents[2] / "docs" / "openai.md"
WORDS = ["I", " go", " now", "\u00e9", "\U0001f600", ".", "\n", '"', "{"]
ROCK = {"action": "Rock"}


def words(rng: random.Random) -> str:
    return "".join(rng.choices(WORDS, k=rng.randrange(1, 9)))


def pieces(rng: random.Random, text: str) -> list[str]:
    """A text in pieces, some of them empty, as servers send them."""
    cuts = sorted(rng.choices(range(len(text) + 1), k=rng.randrange(4)))
    return [text[a:b] for a, b in zip([0, *cuts], [*cuts, len(text)], strict=True)]


def thoughts(rng: random.Random) -> dict[str, Any]:
    """Thoughts as a provider says them."""
    details = [
        {"type": "reasoning.text", "text": words(rng), "index": 0, "format": "f", "signature": "S1"},
        {"type": "reasoning.encrypted", "data": "DATA", "index": 1, "id": "r1"},
    ]
    blocks = [{"type": "thinking", "thinking": words(rng), "signature": f"S{n}"} for n in range(rng.randrange(1, 3))]
    listed = [{"type": "thinking", "thinking": [{"type": "text", "text": words(rng)}]}, {"type": "text", "text": "Go."}]
    shapes = [
        {},
        {"reasoning_content": words(rng)},
        {"reasoning": words(rng)},
        {rng.choice(["reasoning", "reasoning_content"]): ""},
        {"reasoning": words(rng), "reasoning_details": details},
        {"reasoning_content": words(rng), "thinking_blocks": blocks},
        {"content": listed},
        {"x_thoughts": words(rng)},
    ]
    return rng.choice(shapes)


def answer(rng: random.Random) -> dict[str, Any]:
    """A whole completion."""
    calls = []
    for number in range(rng.randrange(4)):
        arguments = rng.choice(['{"action": "Rock"}', '{"action": "' + "a" * rng.randrange(20) + '"}', "{}"])
        function = {"name": rng.choice(["act", "observe"]), "arguments": arguments}
        own = rng.choice([{}, {"extra_content": {"google": {"thought_signature": "G"}}}])
        calls.append({"id": f"call_{number}", "type": "function", "function": function, **own})
    message = {"role": "assistant", "content": rng.choice([None, words(rng)]), **thoughts(rng)}
    message |= {"tool_calls": calls} if calls else {}
    usage = {"prompt_tokens": 9, "completion_tokens": 5, "prompt_tokens_details": {"cached_tokens": 3}}
    finish = "tool_calls" if calls else rng.choice(["stop", "length"])
    return {"choices": [{"index": 0, "message": message, "finish_reason": finish}], "usage": usage}


def parts_of(rng: random.Random, parts: list[dict[str, Any]]) -> list[Any]:
    """A list of parts in pieces: by their index, or one after the other with the signature last."""
    cut = []
    for part in parts:
        field = next((name for name in ("text", "thinking") if isinstance(part.get(name), str)), None)
        if field is None or ((inner := part.get("thinking")) is not None and not isinstance(inner, str)):
            cut.append([part])
            continue
        rest = {name: part[name] for name in part if name not in (field, "signature")}
        cut += [[{**rest, field: piece}] for piece in pieces(rng, part[field])]
        if "signature" in part:
            cut.append([{**rest, "signature": part["signature"]}])
    return cut


def call_pieces(rng: random.Random, calls: list[dict[str, Any]]) -> list[Any]:
    """The calls in deltas: with the name repeated, the arguments as an object, without an index, from 1, or all 0.

    Where each has an index, they may come in another order. A piece may be counted on, as if it were another call, and
    the last one may have the arguments whole again.
    """
    index = rng.choice([None, 0, 1, "zero"])
    repeats, has_object, has_nulls, ids, again, counts_on = (rng.random() < 0.4 for _ in range(6))
    deltas = []
    numbered = [*enumerate(calls)]
    for number, call in reversed(numbered) if isinstance(index, int) and rng.random() < 0.3 else numbered:
        name, arguments = call["function"]["name"], call["function"]["arguments"]
        own = {name: call[name] for name in call if name not in ("id", "function", "type")}
        at = {} if index is None else {"index": 0 if index == "zero" else number + index}
        cut = [json.loads(arguments)] if has_object else ["", *pieces(rng, arguments)]
        for place, piece in enumerate(cut):
            first = place == 0
            function = {"arguments": piece} | (
                {"name": name} if first or repeats else {"name": None} if has_nulls else {}
            )
            said = {"id": call["id"]} if first or ids else {"id": None} if has_nulls else {}
            astray = {"index": 9} if counts_on and at and not (first or repeats or ids) else at
            deltas.append({"tool_calls": [{**astray, **said, "function": function}]})
        if again and not has_object:
            deltas.append({"tool_calls": [{**at, "function": {"arguments": arguments}}]})
        if own:
            deltas.append({"tool_calls": [{**at, **own}]})
    return deltas


def chunks(rng: random.Random, whole: dict[str, Any]) -> list[dict[str, Any]]:
    """A completion as a stream."""
    (choice,) = whole["choices"]
    message = choice["message"]
    deltas: list[Any] = [{"role": "assistant", "content": rng.choice([None, ""])}]
    for field, value in message.items():
        if isinstance(value, str) and field != "role":
            deltas += [{field: piece} for piece in pieces(rng, value)]
        elif isinstance(value, list) and field != "tool_calls":
            deltas += [{field: part} for part in parts_of(rng, value)]
    deltas += call_pieces(rng, message.get("tool_calls", []))
    if rng.random() < 0.3:
        deltas.insert(rng.randrange(len(deltas)), rng.choice([None, {}, {"content": None, "tool_calls": None}]))
    sent = [{"choices": [{"index": 0, "delta": delta, "finish_reason": None}]} for delta in deltas]
    if rng.random() < 0.2:
        sent.insert(rng.randrange(2), {"choices": [], "usage": {"prompt_tokens": 9}})
    ends = [choice["finish_reason"]] * rng.choice([1, 1, 2])
    if choice["finish_reason"] != "length" and rng.random() < 0.2:
        ends = []
    sent += [{"choices": [{"index": 0, "delta": rng.choice([{}, None]), "finish_reason": end}]} for end in ends]
    if rng.random() < 0.5 or not ends:
        return [*sent, {"choices": rng.choice([[], None]), "usage": whole["usage"]}]
    sent[-1]["choices"][0]["usage"] = whole["usage"]
    return sent


def compare_chat(seed: int) -> None:
    rng = random.Random(seed)
    whole = answer(rng)
    cut = chunks(rng, whole)
    assert CHAT.reply(CHAT.assemble(cut)) == CHAT.reply(whole), (seed, whole, cut)


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


@pytest.mark.parametrize("seeds", [range(200), pytest.param(range(200, 4_200), marks=pytest.mark.slow)])
def test_a_stream_gives_the_reply_of_the_whole_answer(seeds):
    for seed in seeds:
        compare_chat(seed)
        if seed % 3 == 0:
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
    whole = CHAT.reply(answer(random.Random(5))).message
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
    rng = random.Random(5)
    for interface, events in ((CHAT, chunks(rng, answer(rng))), (RESPONSES, response(rng)[1])):
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
