"""Conversion of messages between Pydantic AI's classes and the canonical chat form.

A reply goes back to the model as Pydantic AI's own response, with everything that its provider put into it (thinking
and its signatures, for example); what is more than text and calls is recorded as a provider item.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from pydantic_ai.messages import (
    BinaryContent,
    CachePoint,
    ModelMessage,
    ModelMessagesTypeAdapter,
    ModelRequest,
    ModelRequestPart,
    ModelResponse,
    ModelResponsePart,
    SystemPromptPart,
    TextPart,
    ThinkingPart,
    ToolCallPart,
    ToolReturnPart,
    UserContent,
    UserPromptPart,
)
from pydantic_ai.models import Model
from pydantic_ai.models.wrapper import WrapperModel
from pydantic_ai.tools import ToolDefinition
from pydantic_ai.usage import RequestUsage

from smartplay_tools import InvalidArgumentError, Message, ToolSpec, Usage
from smartplay_tools.players import with_end
from smartplay_tools.players.conversion import (
    SYSTEM,
    arguments_text,
    encodable,
    function_call,
    kept_item,
    reply_message,
    sendable,
    shown,
    system_text,
)
from smartplay_tools.types.messages import MessageToolCall, calls_of, text_of
from smartplay_tools.types.pictures import NO_PICTURES, Picture

ITEM = "pydantic_ai_response"
"""The type of the provider item that holds a response with more than text and calls."""


class PydanticAIChat:
    """The messages of one conversation as Pydantic AI's."""

    def __init__(self) -> None:
        self._responses: dict[str, ModelResponse] = {}
        """Every reply's response, by the reply."""

    def remember(self, message: Message, response: ModelResponse) -> None:
        """Have a reply go back to the model as this response."""
        self._responses[_key(message)] = response

    def write(
        self,
        messages: Iterable[Message],
        *,
        marked: Collection[int] = (),
        pictures: Mapping[str, Picture] = NO_PICTURES,
        clean: Callable[[Message], Message] = sendable,
    ) -> list[ModelMessage]:
        """Return messages as Pydantic AI's: all system messages as one, messages between two replies as one request.

        Pydantic AI rewrites a system prompt that does not stand at the beginning, because few providers accept one.
        The user's messages and results at the places `marked` are followed by a mark for the provider's cache.
        `pictures` are those that the messages name. What the record keeps as it was said may have what a request
        cannot, which `clean` takes out.
        """
        said = [*messages]
        messages = [clean(message) for message in said]
        system = system_text(messages)
        written: list[ModelMessage] = []
        names: dict[str, str] = {}
        parts: list[ModelRequestPart] = [] if system is None else [SystemPromptPart(system)]
        for at, message in enumerate(messages):
            if message["role"] in SYSTEM:
                continue
            if message["role"] == "assistant":
                names |= {call["id"]: call["function"]["name"] for call in calls_of(message)}
                written += [*_request(parts), self._response(said[at], message)]
                parts = []
            else:
                parts.append(_request_part(message, names, pictures))
                if at in marked:
                    parts.append(UserPromptPart([CachePoint()]))
        return [*written, *_request(parts)]

    def _response(self, said: Message, message: Message) -> ModelResponse:
        kept = self._responses.get(_key(said))
        return to_response(message) if kept is None or encodable(said) != said else with_calls(kept, message)


def to_response(message: Message) -> ModelResponse:
    """Return a reply as a response of Pydantic AI's."""
    if (item := kept_item(message, ITEM)) is not None:
        (kept,) = ModelMessagesTypeAdapter.validate_python([item["response"]])
        assert isinstance(kept, ModelResponse)
        return with_calls(kept, message)
    text = text_of(message)
    parts: list[ModelResponsePart] = [TextPart(text)] if text else []
    for call in calls_of(message):
        function = call["function"]
        parts.append(ToolCallPart(function["name"], function["arguments"], tool_call_id=call.get("id", "")))
    return ModelResponse(parts)


def from_response(response: ModelResponse) -> Message:
    """Return a response as a reply in canonical form."""
    text = "".join(part.content for part in response.parts if isinstance(part, TextPart))
    sent = [part for part in response.parts if isinstance(part, ToolCallPart)]
    calls = [function_call(call.tool_call_id, call.tool_name, call.args) for call in sent]
    if all(isinstance(part, TextPart | ToolCallPart) for part in response.parts):
        return reply_message(text, calls)
    (dumped,) = ModelMessagesTypeAdapter.dump_python([response], mode="json")
    # The clock does not belong in a record.
    kept = {name: dumped[name] for name in ("kind", "parts", "model_name", "provider_name") if dumped.get(name)}
    thoughts = "".join(part.content for part in response.parts if isinstance(part, ThinkingPart))
    return reply_message(text, calls, {"type": ITEM, "response": kept}, thoughts)


def from_history(messages: Iterable[ModelMessage]) -> list[Message]:
    """Return Pydantic AI's messages in canonical form."""
    history: list[Message] = []
    for message in messages:
        if isinstance(message, ModelResponse):
            history.append(from_response(message))
        else:
            history += [canonical for part in message.parts for canonical in _from_part(part)]
    return history


def since_response(messages: Sequence[ModelMessage]) -> list[Message]:
    """Return the tool results and the host's messages after the latest response."""
    latest = max((at for at, message in enumerate(messages) if isinstance(message, ModelResponse)), default=-1)
    return from_history(messages[latest + 1 :])


def known_by(message: ModelMessage) -> tuple[str, str]:
    """Return what tells a message of the agent's history from others, and its text."""
    parts = [str(getattr(part, "content", None) or getattr(part, "args", None) or "") for part in message.parts]
    return repr(message.parts), "".join(parts)


def usage_of(response: ModelResponse) -> Usage | None:
    """Return the usage of a response, and whether it was cut at its length; None if its provider said nothing."""
    return with_end(read_usage(response.usage), response.finish_reason)


def read_usage(usage: RequestUsage) -> Usage | None:
    """Return the usage that a provider reported; None if it reported none."""
    if not usage.input_tokens and not usage.output_tokens:
        return None
    return Usage(
        prompt=usage.input_tokens,
        reply=usage.output_tokens,
        cached=usage.cache_read_tokens,
        written=usage.cache_write_tokens,
        reasoning=usage.details.get("reasoning_tokens", 0),
    ).checked(usage.total_tokens)


def with_calls(response: ModelResponse, message: Message) -> ModelResponse:
    """Return a response whose calls have the ids, the names and the arguments of those in a message.

    One that has nothing but thoughts, which providers refuse, has the words of the message after them.
    """
    new = iter(calls_of(message))
    parts = [_with_call(part, next(new)) if isinstance(part, ToolCallPart) else part for part in response.parts]
    if (text := text_of(message)) and all(isinstance(part, ThinkingPart) for part in parts):
        parts.append(TextPart(text))
    return replace(response, parts=parts)


def _with_call(part: ToolCallPart, call: MessageToolCall) -> ToolCallPart:
    arguments = call["function"]["arguments"]
    is_same = arguments == arguments_text(part.args)
    name = call["function"]["name"]
    return replace(part, tool_name=name, tool_call_id=call["id"], args=part.args if is_same else arguments)


def tool_spec(tool: ToolDefinition) -> ToolSpec:
    """Return a tool as it is described to a model."""
    return ToolSpec(tool.name, tool.description or "", tool.parameters_json_schema)


def _key(message: Message) -> str:
    return json.dumps(message, sort_keys=True)


def _request(parts: list[ModelRequestPart]) -> list[ModelRequest]:
    return [ModelRequest(parts)] if parts else []


def _request_part(message: Message, names: Mapping[str, str], pictures: Mapping[str, Picture]) -> ModelRequestPart:
    content: str | list[UserContent] = shown(message, pictures, str, _picture)
    if message["role"] == "user":
        return UserPromptPart(content)
    call_id = message["tool_call_id"]
    return ToolReturnPart(tool_name=names.get(call_id, ""), content=content, tool_call_id=call_id)


def _picture(picture: Picture) -> UserContent:
    return BinaryContent(picture.png, media_type="image/png")


def takes_pictures_in_results(model: Model) -> bool:
    """Whether the pictures of results are sent there, with the words as they are: by Anthropic's model and Responses.

    For chat completions Pydantic AI would write the words beside a picture as a JSON list.
    """
    while isinstance(model, WrapperModel):
        model = model.wrapped
    kinds = {kind.__name__ for kind in type(model).__mro__}  # by name: the packages of providers need not be there
    return not kinds.isdisjoint({"AnthropicModel", "OpenAIResponsesModel"})


def _from_part(part: ModelRequestPart) -> list[Message]:
    match part:
        case SystemPromptPart():
            return [{"role": "system", "content": part.content}]
        case ToolReturnPart():
            files = [{"type": file.media_type if isinstance(file, BinaryContent) else file.kind} for file in part.files]
            text = part.model_response_str()
            content: Any = [{"type": "text", "text": text}, *files] if files else text
            return [{"role": "tool", "content": content, "tool_call_id": part.tool_call_id}]
        case UserPromptPart():
            texts = [part.content] if isinstance(part.content, str) else list(part.content)
            if not all(isinstance(text, str) for text in texts):
                raise InvalidArgumentError("Prompts are text only here: anything else cannot be counted.")
            return [{"role": "user", "content": "".join(map(str, texts))}] if any(texts) else []
    raise InvalidArgumentError(f"A {part.part_kind} part of the history cannot be shown in the window.")
