"""The context manager in Pydantic AI, for an agent that exists.

    manager = sp.ContextManager(prompt_tokens=8_000)
    agent = Agent("openai:gpt-4o-mini", capabilities=[ContextManagerCapability(manager)])

A wrapper takes the place of the model that serves a request, after all hooks of all capabilities and after Pydantic AI
has prepared the messages: instructions, tools, output tools and schema count as they are sent. What it sends is not
stored: the run's history has everything.

A request of Pydantic AI's holds several results and words of the user. Each of its parts is a message here, and those
that are shown are put together again.
"""

from __future__ import annotations

import warnings
from collections.abc import AsyncGenerator, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, field, replace
from typing import Any

from pydantic_ai import RunContext
from pydantic_ai.capabilities import AbstractCapability
from pydantic_ai.messages import (
    BinaryContent,
    CachePoint,
    ImageUrl,
    ModelMessage,
    ModelMessagesTypeAdapter,
    ModelRequest,
    ModelRequestPart,
    ModelResponse,
    ModelResponsePart,
    RetryFeedbackPart,
    SystemPromptPart,
    TextContent,
    TextPart,
    ThinkingPart,
    ToolCallPart,
    ToolReturnPart,
    UserPromptPart,
)
from pydantic_ai.models import Model, ModelRequestParameters, StreamedResponse
from pydantic_ai.models.wrapper import WrapperModel
from pydantic_ai.settings import ModelSettings
from pydantic_ai.usage import RequestUsage

from smartplay_pydantic_ai.messages import to_response, tool_spec
from smartplay_tools import ContextManager, FittedPrompt
from smartplay_tools.players import asks_management


class ContextManagerCapability(AbstractCapability[Any]):
    """Holds every request of an agent to the budget of a `ContextManager`; its place among capabilities is free."""

    def __init__(self, manager: ContextManager) -> None:
        self.manager = manager

    def get_wrapper_model(self, model: Model) -> Model:
        """Return a model that sends what fits."""
        return FittedModel(model, self.manager)


class FittedModel(WrapperModel):
    """Takes the place of a model, and sends it what a context manager shows of the messages."""

    def __init__(self, wrapped: Model | str, manager: ContextManager) -> None:
        super().__init__(wrapped)
        self.manager = manager

    async def request(
        self,
        messages: list[ModelMessage],
        model_settings: ModelSettings | None,
        model_request_parameters: ModelRequestParameters,
    ) -> ModelResponse:
        """Ask the model with what fits."""
        prompt, shown = await self._fitted(messages, model_settings, model_request_parameters)
        response = await self.wrapped.request(shown, model_settings, model_request_parameters)
        self._report(prompt, response.usage, model_settings)
        return response

    @asynccontextmanager
    async def request_stream(
        self,
        messages: list[ModelMessage],
        model_settings: ModelSettings | None,
        model_request_parameters: ModelRequestParameters,
        run_context: RunContext[Any] | None = None,
    ) -> AsyncGenerator[StreamedResponse]:
        """Ask the model with what fits, and yield its reply in pieces."""
        prompt, shown = await self._fitted(messages, model_settings, model_request_parameters)
        async with self.wrapped.request_stream(shown, model_settings, model_request_parameters, run_context) as stream:
            yield stream
            self._report(prompt, stream.usage, model_settings)

    async def count_tokens(
        self,
        messages: list[ModelMessage],
        model_settings: ModelSettings | None,
        model_request_parameters: ModelRequestParameters,
    ) -> RequestUsage:
        """Count what fits, as its provider does."""
        _, shown = await self._fitted(messages, model_settings, model_request_parameters)
        return await self.wrapped.count_tokens(shown, model_settings, model_request_parameters)

    def _report(self, prompt: FittedPrompt, usage: RequestUsage, settings: ModelSettings | None) -> None:
        if usage.input_tokens:
            managed = asks_management(self.wrapped.settings, settings)
            self.manager.reported(prompt, usage.input_tokens, managed=managed)

    async def _fitted(
        self, messages: Sequence[ModelMessage], settings: ModelSettings | None, given: ModelRequestParameters
    ) -> tuple[FittedPrompt, list[ModelMessage]]:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the model says the same when it is asked
            _, asked = self.wrapped.prepare_request(settings, given)
        tools = [tool for tool in asked.function_tools if asked.visibility_of(tool.name) != "withheld"]
        instructions = "\n\n".join(part.content for part in asked.instruction_parts or ())
        schema = asked.output_object if asked.output_mode == "native" else None
        said = [each for message in messages for each in _said(message)]
        prompt = await self.manager.afit(
            [each.chat for each in said],
            tools=[
                *map(tool_spec, (*tools, *asked.output_tools)),
                *({"type": tool.kind} for tool in asked.native_tools),
            ],
            system=instructions,
            output_schema=None if schema is None else schema.json_schema,
            form="chat",
        )
        return prompt, as_given(prompt, said)


@dataclass
class Said:
    """One chat message, and what of Pydantic AI's it stands for."""

    chat: dict[str, Any]
    message: ModelMessage
    parts: list[ModelRequestPart] = field(default_factory=list)
    """Those parts of a request that it stands for."""


def as_given(prompt: FittedPrompt, said: Sequence[Said]) -> list[ModelMessage]:
    """Return a fitted prompt in Pydantic AI's messages: those that were given, and copies of those that are shorter."""
    shorter, trimmed = {*prompt.masked, *prompt.elided, *prompt.cut, *prompt.rewritten}, {*prompt.trimmed}
    chats = [*(each.chat for each in said), *prompt.messages]
    names = {call["id"]: call["function"]["name"] for chat in chats for call in chat.get("tool_calls", ())}
    shown: list[ModelMessage] = []
    open_request: ModelMessage | None = None
    """The request whose parts are put together at the end of what is shown."""
    for source, chat in zip(prompt.sources, prompt.messages, strict=True):
        parts: list[ModelRequestPart]
        if source is None and chat["role"] == "assistant":
            shown.append(to_response(chat))
            open_request = None
            continue
        if source is None and chat["role"] != "tool":
            parts = [UserPromptPart(chat["content"]) if chat["role"] == "user" else SystemPromptPart(chat["content"])]
        elif source is None:
            call_id = chat["tool_call_id"]
            parts = [ToolReturnPart(names[call_id], chat["content"], tool_call_id=call_id, outcome="interrupted")]
        elif isinstance(message := said[source].message, ModelResponse):
            calls = [part for part in message.parts if isinstance(part, ToolCallPart)]
            shown.append(replace(message, parts=calls) if source in trimmed else message)
            open_request = None
            continue
        else:
            parts = said[source].parts
            if source in shorter:
                parts = [_shorter(parts[0], chat["content"]), *parts[1:]]
        origin = None if source is None else said[source].message
        last = shown[-1] if shown else None
        if isinstance(last, ModelRequest) and origin is not None and origin is open_request:
            shown[-1] = replace(last, parts=[*last.parts, *parts])
        else:
            shown.append(replace(origin, parts=parts) if isinstance(origin, ModelRequest) else ModelRequest(parts))
            open_request = origin
    originals = {id(each.message): each.message for each in said}
    whole = {tuple(map(id, message.parts)): message for message in originals.values()}
    return [whole.get(tuple(map(id, message.parts)), message) for message in shown]


def _shorter(part: ModelRequestPart, content: Any) -> ModelRequestPart:
    """A result with another content: text, or text and what stands for each of its files."""
    assert isinstance(part, ToolReturnPart)
    if isinstance(content, str):
        made: Any = content
    else:
        text, *rest = content
        files = [file if each["type"] != "text" else each["text"] for file, each in zip(part.files, rest, strict=True)]
        made = [text["text"], *files]
    # A result that is an error would be written as JSON around this text, which would then be longer.
    return ToolReturnPart(part.tool_name, made, part.tool_call_id, metadata=part.metadata, timestamp=part.timestamp)


def _said(message: ModelMessage) -> list[Said]:
    """The chat messages of a message."""
    if isinstance(message, ModelResponse):
        return [Said(_reply(message), message)]
    said: list[Said] = []
    loose: list[ModelRequestPart] = []
    """Parts that only go with others, such as what says that a tool is new."""
    for part in message.parts:
        chat = _chat(part)
        if chat is not None:
            said.append(Said(chat, message, [*loose, part]) if loose else Said(chat, message, [part]))
            loose = []
        elif said:
            said[-1].parts.append(part)
        else:
            loose.append(part)
    if loose:
        said.append(Said({"role": "system", "content": ""}, message, loose))
    for each in said:
        if more := [_plain(ModelRequest([part])) for part in each.parts if _chat(part) is None]:
            each.chat["more"] = more
    return said


def _chat(part: ModelRequestPart) -> dict[str, Any] | None:
    """A part of a request as a chat message; None for one that only goes with others."""
    match part:
        case SystemPromptPart():
            return {"role": "system", "content": part.content}
        case UserPromptPart():
            items = [part.content] if isinstance(part.content, str) else part.content
            contents = [_content(item) for item in items if not isinstance(item, CachePoint)]
            return {"role": "user", "content": contents} if contents else None
        case ToolReturnPart():
            text, files = part.model_response_str(), [_content(file) for file in part.files]
            content: Any = [{"type": "text", "text": text}, *files] if files else text
            return {"role": "tool", "tool_call_id": part.tool_call_id, "content": content}
        case RetryFeedbackPart():
            return {"role": "user", "content": part.model_response()}
    return None


def _content(item: Any) -> dict[str, Any]:
    """Words, or a file as far as it can be counted."""
    match item:
        case str():
            return {"type": "text", "text": item}
        case TextContent():
            return {"type": "text", "text": item.content}
        case BinaryContent() if item.is_image:
            source = {"type": "base64", "media_type": item.media_type, "data": item.base64}
            return {"type": "image", "source": source}
        case ImageUrl():
            return {"type": "image_url", "image_url": {"url": item.url}}
    return {"type": "file", "kind": item.kind}


def _reply(message: ModelResponse) -> dict[str, Any]:
    """A response as a chat message, with everything that is sent of it."""
    content: list[dict[str, Any]] = []
    calls: list[dict[str, Any]] = []
    for part in message.parts:
        if isinstance(part, ToolCallPart):
            function = {"name": part.tool_name, "arguments": part.args_as_json_str()}
            calls.append({"id": part.tool_call_id, "type": "function", "function": function})
        else:
            content.append(_part(part))
    return {"role": "assistant", "content": content, **({"tool_calls": calls} if calls else {})}


def _part(part: ModelResponsePart) -> dict[str, Any]:
    if isinstance(part, TextPart):
        return {"type": "text", "text": part.content}
    if isinstance(part, ThinkingPart):
        is_sealed = part.signature and (not part.content or part.provider_name != "anthropic")
        sealed = {"encrypted_content": part.signature} if is_sealed else {}
        return {"type": "thinking", "thinking": part.content, **sealed}
    return _plain(ModelResponse([part])) | {"type": "file" if part.part_kind == "file" else part.part_kind}


def _plain(message: ModelMessage) -> dict[str, Any]:
    """The one part of a message as plain data."""
    (dumped,) = ModelMessagesTypeAdapter.dump_python([message], mode="json")
    part: dict[str, Any] = dumped["parts"][0]
    return part
