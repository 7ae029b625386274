"""Chat completions: conversion of prompts to requests and of completions to replies, and the reverse for servers.

The canonical messages of `smartplay_tools` have the form of this interface, so little has to be converted: our own
fields are left out, the provider's items are sent back, and the cap on the reply is named.

Impossible names of tools and half characters are rewritten, in requests only. Models behind compatible servers invent a
tool called `go north!`, or stop in the middle of an emoji. The record keeps what they said, but a request that repeats
it would be refused and the episode lost. Everything else is sent as it is in the prompt, call ids included, which the
conversation has made unique.
"""

from __future__ import annotations

import time
import uuid
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from operator import attrgetter
from typing import Any

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.players.attempts import (
    BrokenAnswerError,
    UnreadableAnswerError,
    error_in,
    plain_answer,
    unreadable,
)
from smartplay_tools.players.cache_marks import stable_end
from smartplay_tools.players.conversion import halves, kept_item, received, sendable, taken_back, with_pictures_below
from smartplay_tools.players.usage import read_usage, with_end, written_usage
from smartplay_tools.players.wire.interface import BREAKPOINT, Event, Interface
from smartplay_tools.players.wire.problems import bad, check_calls, objects, read_limit, read_tools
from smartplay_tools.players.wire.stream_pieces import StreamedCall, add_call, merged
from smartplay_tools.players.wire.thinking_parts import added, put_together, taken_apart
from smartplay_tools.players.wire.tool_choice import ToolChoice, read_tool_choice
from smartplay_tools.providers.caps import CAPS
from smartplay_tools.providers.reply_fields import NOT_SENT, THOUGHT_FIELDS
from smartplay_tools.types import Prompt, Reply, SampledTokens, Usage
from smartplay_tools.types.messages import Message, assistant_message, calls_of, pictures_of, reasoning_of, text_of
from smartplay_tools.types.pictures import Picture, is_picture

RENAMED = "chat_reasoning"
"""The type of the provider item of a reply whose thoughts came not as `reasoning_content`, but as its `name` says.

Without one the name is `reasoning`.
"""

CALL_FIELDS = "chat_call_fields"
"""The type of the provider item with what a server has added to each call, such as Gemini's signature of thoughts."""

OF_CALLS = {"id", "index", "type", "function"}
"""The fields of a call that have their own meaning."""

ROLES = ("system", "developer", "user", "assistant", "tool")


class ChatCompletions(Interface):
    """The interface at `/v1/chat/completions`, which most servers support."""

    path = "/v1/chat/completions"
    limit_field = "max_completion_tokens"
    tool_format = "openai"
    required = {"messages": ()}  # noqa: RUF012 - read only
    stream_options = {"stream": True, "stream_options": {"include_usage": True}}  # noqa: RUF012 - read only

    def conversation(self, prompt: Prompt, *, mark: bool) -> dict[str, Any]:
        """Return the messages."""
        prompt = with_pictures_below(prompt)
        messages = [_sent(sendable(message), prompt.pictures) for message in taken_back(prompt.messages)]
        if mark and (at := stable_end(prompt)) is not None:
            marked = {"type": "text", "text": text_of(messages[at]), **BREAKPOINT}
            messages[at] = {**messages[at], "content": [marked]}
        return {"messages": messages}

    def create(self, client: Any) -> Callable[..., Any]:
        """Return `client.chat.completions.create`."""
        create: Callable[..., Any] = client.chat.completions.create
        return create

    def reply(self, answer: Any) -> Reply:
        """Return the reply in a completion."""
        sent = plain_answer(answer)
        usage = read_usage(sent.get("usage"), "chat")
        choices = sent.get("choices")
        choice = choices[0] if isinstance(choices, list) and choices else None
        choice = choice if isinstance(choice, Mapping) else {}
        message, ended = choice.get("message"), choice.get("finish_reason")
        if ended == "error":
            raise BrokenAnswerError(error_in(choice, "The completion ended in an error"), usage, choice.get("error"))
        if message is None and ended and not sent.get("error"):
            message = {}  # of Gemini, where thoughts have used up the cap or a filter has taken the reply
        if not isinstance(message, Mapping):
            raise unreadable(sent, "The completion has no choice with a message", usage)
        try:
            reply = assistant_message(_received(message))
        except InvalidArgumentError as error:
            raise UnreadableAnswerError(str(error), usage) from error
        usage = with_end(usage, ended, "refusal" if message.get("refusal") else None)
        return Reply(reply, usage, _sampled_tokens(choice, sent.get("prompt_token_ids")))

    def assemble(self, parts: Iterable[Any]) -> dict[str, Any]:
        """Return the completion that consists of a stream's chunks."""
        message: dict[str, Any] = {"role": "assistant", "content": None}
        calls: list[StreamedCall] = []
        usage, finished, has_begun, is_over = None, None, False, False
        for chunk in map(plain_answer, parts):
            usage, choices = chunk.get("usage") or usage, objects(chunk.get("choices"))
            # The chunk with the usage has no choices, and comes after the reply; some servers send one before it, too.
            has_begun = has_begun or bool(choices)
            is_over = not choices and (is_over or bool(has_begun and chunk.get("usage")))
            for choice in choices:
                if choice.get("index"):
                    continue  # of several choices the first is the reply
                usage = choice.get("usage") or usage  # Kimi has it here
                if finished in (None, "stop", "tool_calls"):  # of two reasons the one that says more
                    finished = choice.get("finish_reason") or finished
                for delta in objects([choice.get("delta")]):
                    for part in objects(delta.get("tool_calls")):
                        add_call(calls, part, _own_fields(part))
                    _add_fields(message, delta)
        if calls:
            message["tool_calls"] = [call.whole() for call in sorted(calls, key=attrgetter("index"))]
        is_whole = bool(calls) and all(call.is_whole for call in calls)
        if not (finished or is_over or is_whole):
            raise BrokenAnswerError("The stream ended before the reply did.", read_usage(usage, "chat"))
        return {"choices": [{"message": message, "finish_reason": finished}], "usage": usage}

    def read(self, body: Mapping[str, Any]) -> Prompt:
        """Return the prompt in a request."""
        messages = body.get("messages")
        if not isinstance(messages, list) or not messages:
            raise bad("messages is a list of at least one message.", "messages")
        if body.get("n") not in (None, 1):
            raise bad("This endpoint gives one choice: n is 1.", "n")
        canonical = [_message(message, f"messages[{at}]") for at, message in enumerate(messages)]
        check_calls(canonical, "messages")
        limit = read_limit(body, *CAPS)
        return received(canonical, read_tools(body, "function"), limit)

    def read_tool_choice(self, body: Mapping[str, Any]) -> ToolChoice:
        """Return the choice, which names a function under `function`."""
        return read_tool_choice(body, read_tools(body, "function"), "function")

    def write(self, message: Message, model: str, usage: Usage) -> dict[str, Any]:
        """Return the completion with a message."""
        answer: dict[str, Any] = {"role": "assistant", "content": text_of(message) or None, "refusal": None}
        for item in message.get("provider_items", ()):
            if isinstance(item, Mapping) and "type" not in item:
                answer.update(item)
        typed = [item for item in message.get("provider_items", ()) if isinstance(item, Mapping) and "type" in item]
        reasoning = reasoning_of({**message, "provider_items": typed})
        if reasoning or "reasoning_content" in message:
            answer[_name_of_thoughts(message)] = reasoning
        calls = _calls(message)
        if calls:
            answer["tool_calls"] = calls
        ended = "length" if usage.cut else "tool_calls" if calls else "stop"
        choice = {"index": 0, "message": answer, "logprobs": None, "finish_reason": ended}
        return {
            "id": f"chatcmpl-{uuid.uuid4().hex}",
            "object": "chat.completion",
            "created": int(time.time()),
            "model": model,
            "choices": [choice],
            "usage": written_usage(usage, "chat"),
        }

    def stream(self, answer: dict[str, Any], body: Mapping[str, Any]) -> Iterator[Event]:
        """Yield a completion's chunks; the last but one has the usage, if it is requested."""
        (choice,) = answer["choices"]
        envelope = {**answer, "object": "chat.completion.chunk", "usage": None}

        def chunk(delta: dict[str, Any], finish_reason: str | None = None) -> Event:
            choices = [{"index": 0, "delta": delta, "logprobs": None, "finish_reason": finish_reason}]
            return None, {**envelope, "choices": choices}

        message = choice["message"]
        yield chunk({"role": "assistant", "content": None})
        for field, value in message.items():
            if field not in ("role", "tool_calls") and isinstance(value, str):
                for piece in [*halves(value)] or [value]:
                    yield chunk({field: piece})
            elif field not in ("role", "tool_calls") and value is not None:
                yield chunk({field: value})
        for index, call in enumerate(message.get("tool_calls", ())):
            function = {"name": call["function"]["name"], "arguments": ""}
            yield chunk({"tool_calls": [{**call, "index": index, "function": function}]})
            for piece in halves(call["function"]["arguments"]):
                yield chunk({"tool_calls": [{"index": index, "function": {"arguments": piece}}]})
        yield chunk({}, choice["finish_reason"])
        options = body.get("stream_options")
        if isinstance(options, Mapping) and options.get("include_usage"):
            yield None, {**envelope, "choices": [], "usage": answer["usage"]}
        yield None, "[DONE]"


CHAT = ChatCompletions()
"""The Chat Completions interface: requests, replies, tools and messages in its wire format."""

chat_request, chat_reply = CHAT.request, CHAT.reply


def _sent(message: Message, pictures: Mapping[str, Picture]) -> Mapping[str, Any]:
    if pictures_of(message):
        return {**message, "content": [_sent_part(part, pictures) for part in message["content"] or ()]}
    if message["role"] != "assistant":
        return message
    sent: dict[str, Any] = {}
    for item in message.get("provider_items", ()):
        # Items of other interfaces have a type; unknown fields of this interface are fields of the message.
        if isinstance(item, Mapping) and "type" not in item:
            sent.update({field: value for field, value in item.items() if field not in NOT_SENT})
    sent.update({field: value for field, value in message.items() if field != "provider_items"})
    sent["content"] = put_together(message)
    if calls := _calls(message):
        sent["tool_calls"] = calls
    elif sent["content"] is None:
        sent["content"] = ""
    if "reasoning_content" in sent:
        sent[_name_of_thoughts(message)] = sent.pop("reasoning_content")
    return sent


def _name_of_thoughts(message: Message) -> str:
    """The field under which the thoughts of a reply came."""
    renamed = kept_item(message, RENAMED)
    return "reasoning_content" if renamed is None else renamed.get("name", "reasoning")


def _calls(message: Message) -> list[Mapping[str, Any]]:
    """The calls of a message with what a server has added to them."""
    kept, calls = kept_item(message, CALL_FIELDS), calls_of(message)
    return [*calls] if kept is None else [{**own, **call} for own, call in zip(kept["calls"], calls, strict=False)]


def _sent_part(part: Any, pictures: Mapping[str, Picture]) -> Mapping[str, Any]:
    return {"type": "image_url", "image_url": {"url": pictures[part["sha256"]].data_url}} if is_picture(part) else part


def _received(message: Mapping[str, Any]) -> dict[str, Any]:
    received = {**message, "role": "assistant"}
    if refusal := received.pop("refusal", None):
        # The words of a refusal are the reply's text, as they are in the other interface's parts.
        received["content"] = received.get("content") or refusal
    received["content"], thoughts = taken_apart(received.get("content") or None)
    return _with_items(received, thoughts)


def _with_items(message: dict[str, Any], thoughts: Sequence[Mapping[str, Any]] = ()) -> dict[str, Any]:
    """Return a message that has its thoughts, and what a server has added to its calls, as provider items."""
    calls = message.get("tool_calls")
    fields = [_own_fields(call) for call in calls] if isinstance(calls, list) else []
    items = [*thoughts, *([{"type": CALL_FIELDS, "calls": fields}] if any(fields) else [])]
    said = [name for name in THOUGHT_FIELDS if isinstance(message.get(name), str) and (message[name] or calls)]
    if said and message.get("reasoning_content") is None:
        message["reasoning_content"] = message.pop(said[0])
        items.append({"type": RENAMED} if said[0] == "reasoning" else {"type": RENAMED, "name": said[0]})
    return {**message, "provider_items": items} if items else message


def _own_fields(call: Any) -> dict[str, Any]:
    """What a server has added to a call."""
    fields = call if isinstance(call, Mapping) else {}
    return {name: value for name, value in fields.items() if name not in OF_CALLS and value is not None}


def _add_fields(message: dict[str, Any], delta: Mapping[str, Any]) -> None:
    for field, value in delta.items():
        if field in ("role", "tool_calls") or value is None:
            continue
        before = message.get(field)
        message[field] = added(before, value) if field == "content" else merged(before, value)


def _message(message: Any, param: str) -> Message:
    if not isinstance(message, Mapping) or message.get("role") not in ROLES:
        raise bad(f"A message has one of the roles {', '.join(ROLES)}.", param)
    if message.get("content") is None and message["role"] != "assistant":
        raise bad(f"A {message['role']} message has content.", param)
    try:
        text_of(message)
        if message["role"] == "assistant":
            checked = assistant_message(_with_items({**message}))
            if checked["content"] is None and not calls_of(checked):
                raise bad("An assistant message has content or tool calls.", param)
            return checked
    except (AttributeError, TypeError, ValueError) as error:
        raise bad(f"The message cannot be read: {error}", param) from None
    fields = {field: message[field] for field in ("name", "tool_call_id") if message.get(field) is not None}
    if not all(isinstance(value, str) for value in fields.values()):
        raise bad("name and tool_call_id are texts.", param)
    return {"role": message["role"], "content": message["content"], **fields}  # type: ignore[typeddict-item]


def _sampled_tokens(choice: Mapping[str, Any], prompt: Any) -> SampledTokens | None:
    """The tokens of a reply, which vLLM and LMDeploy send where `return_token_ids` asks for them.

    Their probabilities are there if `logprobs` asks for these, too; `prompt` are the prompt's tokens.
    """
    ids, logprobs = choice.get("token_ids"), choice.get("logprobs")
    if not isinstance(ids, list):
        return None
    content = logprobs.get("content") if isinstance(logprobs, Mapping) else None
    try:
        drawn = [each["logprob"] for each in content or ()]
        logprobs = tuple(drawn) if len(drawn) == len(ids) else None
        return SampledTokens(reply=tuple(ids), logprobs=logprobs, prompt=prompt)
    except (KeyError, TypeError, ValueError):
        return None
