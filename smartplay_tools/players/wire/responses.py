"""The stateless Responses interface: conversion of prompts to input items and of output items to replies.

Nothing is stored by the provider (`store=False`), because the context window decides what a model sees. A model's
encrypted reasoning then has to be sent back with the calls that it led to. The output items are therefore kept in order
as the message's `provider_items`, and sent again unchanged as long as their turn is in the window. Only the text of a
message item is removed, because it is in the message itself and would be counted twice.
"""

from __future__ import annotations

import time
import uuid
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import islice
from typing import Any, TypeVar

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.players.attempts import (
    BrokenAnswerError,
    UnreadableAnswerError,
    error_in,
    plain_answer,
    unreadable,
)
from smartplay_tools.players.cache_marks import stable_end
from smartplay_tools.players.conversion import halves, received, sendable, shown, taken_back
from smartplay_tools.players.usage import read_usage, with_end, with_management, written_usage
from smartplay_tools.players.wire.interface import BREAKPOINT, Event, Interface
from smartplay_tools.players.wire.problems import RequestError, bad, check_calls, read_limit, read_tools
from smartplay_tools.players.wire.stream_pieces import StreamedItems
from smartplay_tools.players.wire.thinking_parts import part_of, taken_apart
from smartplay_tools.players.wire.tool_choice import ToolChoice, read_tool_choice
from smartplay_tools.types import Prompt, Reply, Usage
from smartplay_tools.types.messages import Message, MessageToolCall, assistant_message, calls_of, text_of
from smartplay_tools.types.pictures import Picture

A = TypeVar("A")
T = TypeVar("T")

ROLES = ("system", "developer", "user", "assistant")
ENDS = ("response.completed", "response.incomplete", "response.failed", "response.done")
"""The last events of a stream; some servers have the last one."""

UNSET: Mapping[str, Any] = {
    **dict.fromkeys(
        ("completed_at", "max_output_tokens", "max_tool_calls", "previous_response_id", "prompt_cache_key")
    ),
    **dict.fromkeys(("reasoning", "safety_identifier")),
    **dict.fromkeys(("temperature", "top_p"), 1.0),
    **dict.fromkeys(("frequency_penalty", "presence_penalty"), 0.0),
    "background": False,
    "service_tier": "default",
    "text": {"format": {"type": "text"}},
    "top_logprobs": 0,
    "truncation": "disabled",
}
"""Fields that every response has by the specification of Open Responses, as they are where nothing was set."""

ID_PREFIXES = {"message": "msg", "function_call": "fc", "reasoning": "rs"}


class Responses(Interface):
    """The interface at `/v1/responses`."""

    path = "/v1/responses"
    limit_field = "max_output_tokens"
    least_limit = 16
    tool_format = "responses"
    stream_options = {"stream": True}  # noqa: RUF012 - read only

    def conversation(self, prompt: Prompt, *, mark: bool) -> dict[str, Any]:
        """Return the input items, and that nothing is stored."""
        at = stable_end(prompt) if mark else None
        items = [
            _marked(item) if number == at else item
            for number, message in enumerate(map(sendable, taken_back(prompt.messages)))
            for item in _items(message, prompt.pictures)
        ]
        return {"input": items, "store": False, "include": ["reasoning.encrypted_content"]}

    def create(self, client: Any) -> Callable[..., Any]:
        """Return `client.responses.create`."""
        create: Callable[..., Any] = client.responses.create
        return create

    def reply(self, answer: Any) -> Reply:
        """Return the reply in a response."""
        sent = plain_answer(answer)
        usage = read_usage(sent.get("usage"), "responses")
        output, why = sent.get("output"), sent.get("incomplete_details")
        reason = why.get("reason") if isinstance(why, Mapping) else None
        if output is None and reason:
            output = []  # as a choice without a message
        if sent.get("status") in ("failed", "cancelled"):
            raise BrokenAnswerError(error_in(sent, "The response has failed"), usage, sent.get("error"))
        if not isinstance(output, list):
            raise unreadable(sent, "The response has no output", usage)
        try:
            message = read_items([item for item in output if isinstance(item, Mapping)])
        except InvalidArgumentError as error:
            raise UnreadableAnswerError(str(error), usage) from error
        return Reply(message, with_management(with_end(usage, reason, *_parts(output)), sent, output))

    def assemble(self, parts: Iterable[Any]) -> dict[str, Any]:
        """Return the response that ends a stream of events; some servers leave out of it what they have streamed."""
        items = StreamedItems()
        for event in map(plain_answer, parts):
            items.add(event)
            if event.get("type") in ENDS:
                answer = plain_answer(event.get("response"))
                return answer if answer.get("output") else {**answer, "output": items.output}
            if event.get("type") == "error":
                raise BrokenAnswerError(f"The stream failed: {event.get('message')}.", body=event)
        if not items.is_whole:
            raise BrokenAnswerError("The stream ended before the reply did.")
        return {"output": items.output}

    def read(self, body: Mapping[str, Any]) -> Prompt:
        """Return the prompt in a request, which contains the whole input, since nothing is stored."""
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
        return received(messages, read_tools(body, None), read_limit(body, "max_output_tokens"))

    def read_tool_choice(self, body: Mapping[str, Any]) -> ToolChoice:
        """Return the choice, which names a function next to its type."""
        return read_tool_choice(body, read_tools(body, None), None)

    def write(self, message: Message, model: str, usage: Usage) -> dict[str, Any]:
        """Return the response with a message."""
        output = []
        for item in output_items(message):
            prefix = ID_PREFIXES.get(item["type"], "item")
            fresh = {"id": f"{prefix}_{uuid.uuid4().hex}", "status": "completed"}
            output.append({**(fresh if item["type"] != "reasoning" else {"id": fresh["id"], "summary": []}), **item})
        return {
            "id": f"resp_{uuid.uuid4().hex}",
            "object": "response",
            "created_at": int(time.time()),
            "status": "incomplete" if usage.cut else "completed",
            "error": None,
            "incomplete_details": {"reason": "max_output_tokens"} if usage.cut else None,
            "instructions": None,
            "metadata": {},
            "model": model,
            "output": output,
            "parallel_tool_calls": True,
            "tool_choice": "auto",
            "tools": [],
            "store": False,
            "usage": written_usage(usage, "responses"),
            **UNSET,
        }

    def stream(self, answer: dict[str, Any], body: Mapping[str, Any]) -> Iterator[Event]:
        """Yield a response's events."""
        for number, (kind, event) in enumerate(_events(answer)):
            yield kind, {"type": kind, "sequence_number": number, **event}

    def failure(self, error: RequestError) -> Event:
        """Return the event of a stream that ends without a response; OpenAI's client looks for the error below."""
        told = error.body()["error"]
        return "error", {**told, "type": "error", "sequence_number": 0, "error": told}


RESPONSES = Responses()
"""The Responses interface: requests, replies, tools and items in its wire format."""

responses_request, responses_reply = RESPONSES.request, RESPONSES.reply


def read_items(items: Iterable[Mapping[str, Any]]) -> Message:
    """Return the message of output items, which it contains unchanged except for their text."""
    texts, calls, kept = [], [], []
    for item in items:
        match item.get("type", "message"):
            case "message":
                words, others = taken_apart(item.get("content"))
                texts.append(_text_of(words))
                item = {**item, "type": "message", "content": [*others]}
            case "function_call":
                function = {"name": item.get("name"), "arguments": item.get("arguments")}
                calls.append({"id": item.get("call_id"), "type": "function", "function": function})
        kept.append(item)
    return assistant_message(
        {"role": "assistant", "content": _content(texts), "tool_calls": calls, "provider_items": kept}
    )


def _parts(output: Iterable[Any]) -> Iterator[Any]:
    """The types of the parts of an output's messages, of which one is a refusal."""
    for item in output:
        content = item.get("content") if isinstance(item, Mapping) and item.get("type") == "message" else None
        yield from (part.get("type") for part in content or () if isinstance(part, Mapping))


def _text_of(content: Any) -> str:
    """The text of an item's content; `InvalidArgumentError` if it is neither text nor a list of text parts."""
    if not isinstance(content, str | list | None):
        raise InvalidArgumentError("The content of an item is text or a list of text parts.")
    return text_of({"content": content})


def _content(texts: list[str]) -> str | list[dict[str, str]] | None:
    # A part for each message item, so that each gets its own text back.
    return [{"type": "text", "text": text} for text in texts] if len(texts) > 1 else "".join(texts) or None


def _items(message: Message, pictures: Mapping[str, Picture]) -> Iterator[dict[str, Any]]:
    if message["role"] == "tool":
        output = _content_sent(message, pictures)
        yield {"type": "function_call_output", "call_id": message.get("tool_call_id"), "output": output}
    elif message["role"] == "assistant":
        kind = None
        for item in output_items(message):
            if (sent := _sent_back(item)) is not None:
                kind = sent["type"]
                yield sent
        if kind == "reasoning":  # is refused without an item that follows it
            yield {"type": "message", "role": "assistant", "content": _output_text("")}
    else:
        yield {"role": message["role"], "content": _content_sent(message, pictures)}


def _sent_back(item: dict[str, Any]) -> dict[str, Any] | None:
    """An output item as an input item: without what is null, and a thought without the state of its making.

    A thought of which nothing but a summary is there can be read by no model, and its id is unknown to a server that
    stores nothing. With `provider_data` the Agents SDK has made it of a chat completion, and makes one of it again.
    """
    if None in item.values():
        item = {name: value for name, value in item.items() if value is not None}
    if item["type"] != "reasoning":
        return item
    is_readable = item.get("encrypted_content") or item.get("content") or "provider_data" in item
    return {name: value for name, value in item.items() if name != "status"} if is_readable else None


def _content_sent(message: Message, pictures: Mapping[str, Picture]) -> str | list[dict[str, Any]]:
    return shown(message, pictures, _text_sent, lambda picture: {"type": "input_image", "image_url": picture.data_url})


def _text_sent(text: str) -> dict[str, Any]:
    return {"type": "input_text", "text": text}


def _marked(item: dict[str, Any]) -> dict[str, Any]:
    """An input item, which is not the assistant's, with a mark for the cache."""
    field = "output" if item.get("type") == "function_call_output" else "content"
    parts = item[field] if isinstance(item[field], list) else [_text_sent(item[field])]
    return {**item, field: [*parts[:-1], {**parts[-1], **BREAKPOINT}]}


def output_items(message: Message) -> Iterator[dict[str, Any]]:
    """The items of which an assistant message was made; for other messages, items with the same content.

    A message of another interface has none of the first two types, and what that interface has added to it stays away.
    """
    words, calls = _texts(message), iter(calls_of(message))
    items = [item for item in message.get("provider_items", ()) if isinstance(item, Mapping) and "type" in item]
    is_own = any(item["type"] in ("message", "function_call") for item in items)
    for item in items:
        match item["type"]:
            case "message":
                others = [part_of(other) for other in item.get("content") or ()]
                yield {**item, "content": [*others, *_output_text(next(words, ""))]}
            case "function_call":
                yield from ({**item, **_call(call)} for call in islice(calls, 1))  # none if it does not go back
            case kind if is_own or kind == "reasoning":
                yield dict(item)
    for text in words:
        yield {"type": "message", "role": "assistant", "content": _output_text(text)}
    for call in calls:
        yield {"type": "function_call", **_call(call)}


def _output_text(text: str) -> list[dict[str, Any]]:
    return [{"type": "output_text", "text": text, "annotations": []}]


def _call(call: MessageToolCall) -> dict[str, Any]:
    return {"call_id": call["id"], **call["function"]}


def _texts(message: Message) -> Iterator[str]:
    """The text of each message item; a message without calls has at least one, which may be empty."""
    content = message["content"]
    if isinstance(content, list):
        yield from (text_of({"content": [part]}) for part in content)
    elif content or not calls_of(message):
        yield content or ""


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
    yield f"response.{response['status']}", {"response": response}


def _instructions(body: Mapping[str, Any]) -> Iterator[Message]:
    if instructions := body.get("instructions"):
        yield {"role": "system", "content": str(instructions)}


def _messages(items: list[Any]) -> Iterator[Message]:
    """The canonical messages of a request's items; consecutive items of the assistant are one message."""
    output: list[Mapping[str, Any]] = []
    begin = ""
    for at, item in enumerate(items):
        param = f"input[{at}]"
        if not isinstance(item, Mapping):
            raise bad("An input item is an object.", param)
        kind = item.get("type") or "message"
        if kind == "message" and item.get("role") not in ROLES:
            raise bad(f"A message has one of the roles {', '.join(ROLES)}.", param)
        is_output = kind != "function_call_output" and item.get("role") not in ("system", "developer", "user")
        if is_output:
            begin = begin if output else param
            output.append(item)
            continue
        if output:
            yield _readable(read_items, output, begin)
            output = []
        if kind == "function_call_output":
            text = _text(item.get("output"), param)
            yield {"role": "tool", "content": text, "tool_call_id": str(item.get("call_id"))}
        else:
            yield {"role": item["role"], "content": _text(item.get("content"), param)}
    if output:
        yield _readable(read_items, output, begin)


def _text(content: Any, param: str) -> str:
    return _readable(_text_of, content, param)


def _readable(read: Callable[[A], T], sent: A, param: str) -> T:
    """What is read from a part of a request; if it cannot be read, the request is refused."""
    try:
        return read(sent)
    except ValueError as error:
        raise bad(str(error), param) from None
