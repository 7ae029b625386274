"""The Responses interface, the server's side: requests read, responses and their streams written."""

from __future__ import annotations

import time
import uuid
from collections.abc import Iterator, Mapping
from typing import Any

from smartplay_openai.responses import output_items, read_items
from smartplay_openai.server.chat import halves
from smartplay_openai.server.problems import RequestError, bad, check_calls, read_limit, read_tool
from smartplay_tools import Message, Prompt, Usage
from smartplay_tools.messages import text_of

PATH = "/v1/responses"
ROLES = ("system", "developer", "user", "assistant")
ID_PREFIXES = {"message": "msg", "function_call": "fc", "reasoning": "rs"}


def read(body: Mapping[str, Any]) -> Prompt:
    """Return the prompt that a request holds; a request that OpenAI would refuse raises `RequestError`."""
    if body.get("previous_response_id") or body.get("conversation"):
        problem = "This endpoint stores nothing: send the whole input, with store=false."
        raise RequestError(400, problem, param="previous_response_id", code="previous_response_not_found")
    items = body.get("input")
    if isinstance(items, str):
        items = [{"role": "user", "content": items}]
    if not isinstance(items, list) or not items:
        raise bad("input is a text, or a list of at least one item.", "input")
    messages = [*_instructions(body), *_messages(items)]
    check_calls(messages, "input")
    tools = body.get("tools") or []
    specs = tuple(read_tool(_flat(tool), f"tools[{at}]") for at, tool in enumerate(tools))
    return Prompt(messages, specs, read_limit(body, "max_output_tokens"))


def write(message: Message, model: str, usage: Usage) -> dict[str, Any]:
    """Return the response that says a message."""
    output = []
    for item in output_items(message):
        prefix = ID_PREFIXES.get(item["type"], "item")
        fresh = {"id": f"{prefix}_{uuid.uuid4().hex}", "status": "completed"}
        if item["type"] == "function_call":
            item = {**item, "call_id": f"call_{uuid.uuid4().hex[:24]}"}
        output.append({**(fresh if item["type"] != "reasoning" else {"id": fresh["id"], "summary": []}), **item})
    return {
        "id": f"resp_{uuid.uuid4().hex}",
        "object": "response",
        "created_at": int(time.time()),
        "status": "completed",
        "error": None,
        "incomplete_details": None,
        "instructions": None,
        "metadata": {},
        "model": model,
        "output": output,
        "parallel_tool_calls": True,
        "temperature": None,
        "tool_choice": "auto",
        "tools": [],
        "top_p": None,
        "store": False,
        "usage": {
            "input_tokens": usage.prompt,
            "input_tokens_details": {"cached_tokens": usage.cached, "cache_write_tokens": 0},
            "output_tokens": usage.reply,
            "output_tokens_details": {"reasoning_tokens": usage.reasoning},
            "total_tokens": usage.prompt + usage.reply,
        },
    }


def stream(response: dict[str, Any], body: Mapping[str, Any]) -> Iterator[tuple[str | None, dict[str, Any] | str]]:
    """Yield a response's events, as (event name, data)."""
    for number, (kind, event) in enumerate(_events(response)):
        yield kind, {"type": kind, "sequence_number": number, **event}


def _events(response: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    yield "response.created", {"response": {**response, "status": "in_progress", "output": [], "usage": None}}
    for index, item in enumerate(response["output"]):
        where = {"output_index": index, "item_id": item["id"]}
        empty = {field: type(item[field])() for field in ("content", "arguments") if field in item}
        yield "response.output_item.added", {"output_index": index, "item": {**item, "status": "in_progress", **empty}}
        if item["type"] == "message":
            for part, content in enumerate(item["content"]):
                place = {**where, "content_index": part}
                yield "response.content_part.added", {**place, "part": {**content, "text": ""}}
                for piece in halves(content["text"]):
                    yield "response.output_text.delta", {**place, "delta": piece, "logprobs": []}
                yield "response.output_text.done", {**place, "text": content["text"], "logprobs": []}
                yield "response.content_part.done", {**place, "part": content}
        elif item["type"] == "function_call":
            for piece in halves(item["arguments"]):
                yield "response.function_call_arguments.delta", {**where, "delta": piece}
            done = {"name": item["name"], "arguments": item["arguments"]}
            yield "response.function_call_arguments.done", {**where, **done}
        yield "response.output_item.done", {"output_index": index, "item": item}
    yield "response.completed", {"response": response}


def _instructions(body: Mapping[str, Any]) -> Iterator[Message]:
    if instructions := body.get("instructions"):
        yield {"role": "system", "content": str(instructions)}


def _messages(items: list[Any]) -> Iterator[Message]:
    """The canonical messages of a request's items; what the assistant put out in a row is one message."""
    output: list[Mapping[str, Any]] = []
    for at, item in enumerate(items):
        param = f"input[{at}]"
        if not isinstance(item, Mapping):
            raise bad("An input item is an object.", param)
        kind = item.get("type") or "message"
        if kind == "message" and item.get("role") not in ROLES:
            raise bad(f"A message has one of the roles {', '.join(ROLES)}.", param)
        is_output = kind != "function_call_output" and item.get("role") not in ("system", "developer", "user")
        if is_output:
            output.append(item)
            continue
        if output:
            yield read_items(output)
            output = []
        if kind == "function_call_output":
            text = _text(item.get("output"), param)
            yield {"role": "tool", "content": text, "tool_call_id": str(item.get("call_id"))}
        else:
            yield {"role": item["role"], "content": _text(item.get("content"), param)}
    if output:
        yield read_items(output)


def _text(content: Any, param: str) -> str:
    try:
        return text_of({"content": content})
    except (TypeError, ValueError) as error:
        raise bad(str(error), param) from None


def _flat(tool: Any) -> Any:
    return tool if isinstance(tool, Mapping) and tool.get("type") == "function" else None
