"""How answers are written: the three interfaces as their inventors have them, whole and as streams.

A dialect changes them by its rules. A stream is cut at random places, by the number of the reply.
"""

from __future__ import annotations

import json
import random
from collections.abc import Iterator
from typing import Any

from tests.dialects.said import CUT, FILTERED, REFUSED, Json, Said

PROMPT, CACHED, REPLY = 90, 40, 7
"""The tokens that every answer reports."""

CUT_FIELDS = ("text", "thinking", "summary")
"""The fields of a part of thoughts in which its text is."""


def ids_of(said: Said, number: int, shape: str) -> list[str]:
    """The ids of a reply's calls; `shape` has the number of the reply and of the call."""
    return [shape.format(number, 0 if said.same_ids else at) for at in range(len(said.calls))]


def chat(said: Said, number: int, shape: str) -> Json:
    """A chat completion."""
    message: Json = {"role": "assistant", "content": said.words or None}
    if said.end == REFUSED:
        message |= {"content": None, "refusal": said.words}
    ids = ids_of(said, number, shape)
    calls = [
        {"id": ids[at], "type": "function", "function": {"name": name, "arguments": arguments}}
        for at, (name, arguments) in enumerate(said.calls)
    ]
    if calls:
        message["tool_calls"] = calls
    ended = {CUT: "length", FILTERED: "content_filter"}.get(said.end, "tool_calls" if calls else "stop")
    usage = {"prompt_tokens": PROMPT, "completion_tokens": REPLY, "total_tokens": PROMPT + REPLY}
    choice = {"index": 0, "message": message, "logprobs": None, "finish_reason": ended}
    head = {"id": f"chatcmpl-{number}", "object": "chat.completion", "created": 1, "model": "m"}
    return {**head, "choices": [choice], "usage": usage | {"prompt_tokens_details": {"cached_tokens": CACHED}}}


def pieces(text: str, chance: random.Random) -> list[str]:
    """A text in one to four pieces, none of them empty."""
    places = sorted(chance.sample(range(1, len(text)), min(len(text) - 1, chance.randrange(4)))) if text else []
    return [text[begin:end] for begin, end in zip([0, *places], [*places, None], strict=True) if text[begin:end]]


def chat_stream(answer: Json, chance: random.Random) -> list[Any]:
    """A chat completion as chunks; the last but one has the usage."""
    (choice,) = answer["choices"]
    head = {**answer, "object": "chat.completion.chunk", "usage": None}

    def chunk(delta: Json, ended: str | None = None) -> Json:
        return {**head, "choices": [{"index": 0, "delta": delta, "logprobs": None, "finish_reason": ended}]}

    silent = choice["message"].get("content") is None
    chunks = [chunk({"role": "assistant", "content": None if silent else ""})]
    for name, value in choice["message"].items():
        if name in ("role", "tool_calls"):
            continue
        if isinstance(value, str):
            chunks += [chunk({name: piece}) for piece in pieces(value, chance) or [""]]
        elif isinstance(value, list):
            chunks += [chunk({name: [piece]}) for part in value for piece in _parts(part, chance)]
        elif value is not None:
            chunks.append(chunk({name: value}))
    for index, call in enumerate(choice["message"].get("tool_calls", ())):
        function = call["function"]
        first = {**call, "index": index, "function": {"name": function["name"], "arguments": ""}}
        chunks.append(chunk({"tool_calls": [first]}))
        texts = (
            pieces(function["arguments"], chance) if isinstance(function["arguments"], str) else [function["arguments"]]
        )
        chunks += [chunk({"tool_calls": [{"index": index, "function": {"arguments": text}}]}) for text in texts]
    return [*chunks, chunk({}, choice["finish_reason"]), {**head, "choices": [], "usage": answer["usage"]}, "[DONE]"]


def _parts(part: Any, chance: random.Random) -> Iterator[Any]:
    """A part of thoughts in pieces, of which the last has the signature and no text, where there is one."""
    (name,) = [name for name in CUT_FIELDS if name in part] or [None]
    if name is None:
        yield part
        return
    nested, signed = isinstance(part[name], list), {key: part[key] for key in ("signature",) if key in part}
    fixed = {key: value for key, value in part.items() if key not in (name, "signature")}
    for piece in pieces(part[name][0]["text"] if nested else part[name], chance):
        yield {**fixed, name: [{"type": "text", "text": piece}] if nested else piece}
    if signed:
        yield {**fixed, **signed}


def responses(said: Said, number: int, shape: str) -> Json:
    """A response."""
    output: list[Json] = []
    if said.thoughts:
        summary = [{"type": "summary_text", "text": said.thoughts}]
        output.append({"type": "reasoning", "id": f"rs_{number}", "summary": summary, "encrypted_content": "gAAA" * 20})
    if said.words or not (said.calls or said.thoughts):
        part: Json = {"type": "output_text", "text": said.words, "annotations": [], "logprobs": []}
        part = {"type": "refusal", "refusal": said.words} if said.end == REFUSED else part
        item = {"type": "message", "id": f"msg_{number}", "role": "assistant", "status": "completed", "content": [part]}
        output += [item] if said.words else []
    for at, (call_id, (name, arguments)) in enumerate(zip(ids_of(said, number, shape), said.calls, strict=True)):
        fixed = {"type": "function_call", "id": f"fc_{number}_{at}", "status": "completed"}
        output.append({**fixed, "call_id": call_id, "name": name, "arguments": arguments})
    why = {CUT: "max_output_tokens", FILTERED: "content_filter"}.get(said.end)
    usage = {"input_tokens": PROMPT, "output_tokens": REPLY, "total_tokens": PROMPT + REPLY}
    usage |= {"input_tokens_details": {"cached_tokens": CACHED}, "output_tokens_details": {"reasoning_tokens": 0}}
    fixed = {"parallel_tool_calls": True, "tool_choice": "auto", "tools": [], "error": None, "model": "m"}
    ended = {"status": "incomplete" if why else "completed", "incomplete_details": {"reason": why} if why else None}
    return {
        "id": f"resp_{number}",
        "object": "response",
        "created_at": 1,
        **fixed,
        **ended,
        "output": output,
        "usage": usage,
    }


def responses_stream(answer: Json, chance: random.Random) -> list[Any]:
    """A response as events. Texts and summaries come whole: clients read them from the last event."""
    begun = {**answer, "status": "in_progress", "output": [], "usage": None, "incomplete_details": None}
    events: list[Json] = [{"type": "response.created", "response": begun}]
    for index, item in enumerate(answer["output"]):
        place = {"output_index": index}
        empty = {**item, "arguments": ""} if item["type"] == "function_call" else item
        events.append({"type": "response.output_item.added", **place, "item": {**empty, "status": "in_progress"}})
        if item["type"] == "function_call":
            place["item_id"] = item["id"]
            delta = {"type": "response.function_call_arguments.delta", **place}
            events += [{**delta, "delta": piece} for piece in pieces(item["arguments"], chance)]
            done = {"name": item["name"], "arguments": item["arguments"]}
            events.append({"type": "response.function_call_arguments.done", **place, **done})
        events.append({"type": "response.output_item.done", "output_index": index, "item": item})
    events.append({"type": f"response.{answer['status']}", "response": answer})
    return [{**event, "sequence_number": at} for at, event in enumerate(events)]


def messages(said: Said, number: int, shape: str) -> Json:
    """An answer of the Messages interface, whose arguments are objects."""
    blocks: list[Json] = []
    if said.thoughts:
        blocks.append({"type": "thinking", "thinking": said.thoughts, "signature": f"sig{number}" * 20})
    blocks += [{"type": "text", "text": said.words}] if said.words else []
    for call_id, (name, arguments) in zip(ids_of(said, number, shape), said.calls, strict=True):
        blocks.append({"type": "tool_use", "id": call_id, "name": name, "input": json.loads(arguments)})
    ended = {CUT: "max_tokens", REFUSED: "refusal", FILTERED: "refusal"}.get(
        said.end, "tool_use" if said.calls else "end_turn"
    )
    usage = {"input_tokens": PROMPT - CACHED, "cache_read_input_tokens": CACHED, "cache_creation_input_tokens": 0}
    head = {"id": f"msg_{number}", "type": "message", "role": "assistant", "model": "m"}
    return {
        **head,
        "content": blocks,
        "stop_reason": ended,
        "stop_sequence": None,
        "usage": usage | {"output_tokens": REPLY},
    }


def messages_stream(answer: Json, chance: random.Random) -> list[Any]:
    """The same as events."""
    begun = {**answer, "content": [], "stop_reason": None, "usage": {**answer["usage"], "output_tokens": 1}}
    events: list[Json] = [{"type": "message_start", "message": begun}, {"type": "ping"}]
    for index, block in enumerate(answer["content"]):
        deltas: list[Json]
        match block["type"]:
            case "text":
                empty, deltas = {"text": ""}, [{"type": "text_delta", "text": t} for t in pieces(block["text"], chance)]
            case "thinking":
                empty = {"thinking": "", "signature": ""}
                deltas = [{"type": "thinking_delta", "thinking": t} for t in pieces(block["thinking"], chance)]
                deltas.append({"type": "signature_delta", "signature": block["signature"]})
            case _:
                empty, text = {"input": {}}, json.dumps(block["input"])
                deltas = [{"type": "input_json_delta", "partial_json": t} for t in ["", *pieces(text, chance)]]
        events.append({"type": "content_block_start", "index": index, "content_block": {**block, **empty}})
        events += [{"type": "content_block_delta", "index": index, "delta": delta} for delta in deltas]
        events.append({"type": "content_block_stop", "index": index})
    ended = {"stop_reason": answer["stop_reason"], "stop_sequence": None}
    events.append(
        {"type": "message_delta", "delta": ended, "usage": {"output_tokens": answer["usage"]["output_tokens"]}}
    )
    return [*events, {"type": "message_stop"}]
