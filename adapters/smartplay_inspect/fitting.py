"""The context manager in Inspect: a model around another, for an agent that exists.

    model = get_model("window/openai/gpt-4o-mini", prompt_tokens=8_000)

`window/PROVIDER/MODEL` is a model that sends PROVIDER/MODEL what fits, on the command line as well
(`--model window/openai/gpt-4o-mini -M prompt_tokens=8000`). `fitted_model` is the same with a manager of one's own.
The messages of the sample's state stay whole.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from typing import Any

from inspect_ai.model import (
    ChatMessage,
    ChatMessageAssistant,
    ChatMessageTool,
    Content,
    ContentImage,
    ContentReasoning,
    ContentText,
    GenerateConfig,
    Model,
    ModelAPI,
    ModelOutput,
    get_model,
    modelapi,
)
from inspect_ai.model._model import collapse_consecutive_messages_for_api  # no public name; tried with 0.3.285
from inspect_ai.tool import ToolChoice, ToolInfo

from smartplay_inspect.messages import read_usage, sent_arguments, to_inspect, tool_specs
from smartplay_tools import ContextManager, FittedPrompt, InvalidArgumentError
from smartplay_tools.players import asks_management
from smartplay_tools.players.conversion import function_call
from smartplay_tools.types.messages import calls_of

OPTIONS = frozenset(inspect.signature(ContextManager).parameters)
"""The arguments of a `ContextManager`."""


def fitted_model(model: Model | str, manager: ContextManager) -> Model:
    """Return a model that sends another one what a context manager shows of the messages."""
    other = get_model(model)
    return Model(window(str(other), config=other.config, other=other, manager=manager), other.config)


class WindowModel(ModelAPI):
    """The model `window/PROVIDER/MODEL`. Its options are those of a `ContextManager`; others are the model's."""

    def __init__(
        self,
        model_name: str,
        base_url: str | None = None,
        api_key: str | None = None,
        config: GenerateConfig = GenerateConfig(),  # noqa: B008 - Inspect's signature
        *,
        other: Model | None = None,
        manager: ContextManager | None = None,
        **options: Any,
    ) -> None:
        super().__init__(model_name, base_url, api_key, [], config)
        own = {name: options.pop(name) for name in OPTIONS & options.keys()}
        if manager is None or other is None:
            self._check(own, manager)
        self.manager = manager or ContextManager(**own)
        other = other or get_model(
            model_name, config=config, base_url=base_url, api_key=api_key, memoize=False, **options
        )
        self.api: ModelAPI = other.api

    @staticmethod
    def _check(options: dict[str, Any], manager: ContextManager | None) -> None:
        """Refuse what Inspect would take for the same when it looks for a model that it has made before."""
        if manager is not None or any(
            not isinstance(value, str | int | float | bool | None) for value in options.values()
        ):
            raise InvalidArgumentError(
                "Options of `window` are texts and numbers; for a manager with others use "
                "smartplay_inspect.fitted_model(model, manager)."
            )
        if "prompt_tokens" not in options:
            raise InvalidArgumentError("A `window` model needs prompt_tokens, the cap on every prompt.")

    async def generate(
        self,
        input: list[ChatMessage],  # noqa: A002 - Inspect's name
        tools: list[ToolInfo],
        tool_choice: ToolChoice,
        config: GenerateConfig,
    ) -> Any:
        """Ask the model with what fits."""
        schema = config.response_schema
        prompt = await self.manager.afit(
            [as_chat(message) for message in input],
            tools=tool_specs(tools),
            output_schema=None if schema is None else schema.model_dump(mode="json", exclude_none=True),
            form="chat",
        )
        # Those that come to stand beside each other, as Inspect joins them for some providers.
        shown = collapse_consecutive_messages_for_api(as_given(prompt, input), self.api)
        made = await self.api.generate(shown, tools, tool_choice, config)
        output = made[0] if isinstance(made, tuple) else made
        usage = read_usage(output.usage) if isinstance(output, ModelOutput) else None
        if usage is not None and usage.prompt:
            self.manager.reported(prompt, usage.prompt, managed=asks_management(config.extra_body))
        return made

    def __getattr__(self, name: str) -> Any:
        """Return what only the model has."""
        if name == "api":
            raise AttributeError(name)
        return getattr(self.api, name)


def _passed_on(name: str) -> Callable[..., Any]:
    def call(self: WindowModel, *given: Any, **named: Any) -> Any:
        return getattr(self.api, name)(*given, **named)

    return call


for _name, _method in vars(ModelAPI).items():
    if inspect.isfunction(_method) and not _name.startswith("_") and _name != "generate":
        setattr(WindowModel, _name, _passed_on(_name))

window: Any = modelapi(name="window")(WindowModel)
"""Makes a `WindowModel`, as Inspect finds it by its name."""


def as_given(prompt: FittedPrompt, given: Sequence[ChatMessage]) -> list[ChatMessage]:
    """Return a fitted prompt in Inspect's messages: those that were given, and copies of those that are shorter."""
    shorter, trimmed = {*prompt.masked, *prompt.elided, *prompt.cut, *prompt.rewritten}, {*prompt.trimmed}
    replies = (message for message in given if isinstance(message, ChatMessageAssistant))
    functions = {call.id: call.function for reply in replies for call in reply.tool_calls or ()}
    shown: list[ChatMessage] = []
    for source, chat in zip(prompt.sources, prompt.messages, strict=True):
        if source is None:
            functions |= {call["id"]: call["function"]["name"] for call in calls_of(chat)}
            shown.append(to_inspect(chat, functions))
        elif source in trimmed:
            shown.append(given[source].model_copy(update={"content": ""}))
        elif source in shorter:
            content = _contents(chat["content"], given[source].content)
            shown.append(given[source].model_copy(update={"content": content, "error": None}))
        else:
            shown.append(given[source])
    return shown


def _contents(content: Any, given: str | list[Content]) -> str | list[Content]:
    """The content of a result that is shorter: its text, and those of its other parts that stay."""
    if isinstance(content, str) or isinstance(given, str):
        return str(content)
    return [ContentText(text=part["text"]) if part["type"] == "text" else given[part["place"]] for part in content]


def as_chat(message: ChatMessage) -> dict[str, Any]:
    """Return a message in the chat form, with everything that is sent of it."""
    content: Any = message.content
    if not isinstance(content, str):
        content = [_content(part, place) for place, part in enumerate(content)]
    chat: dict[str, Any] = {"role": message.role, "content": content}
    if isinstance(message, ChatMessageTool):
        chat["tool_call_id"] = message.tool_call_id or ""
        if message.error is not None:
            chat["content"] = f"Error: {message.error.message}"
    if isinstance(message, ChatMessageAssistant) and message.tool_calls:
        chat["tool_calls"] = [function_call(c.id, c.function, sent_arguments(c)) for c in message.tool_calls]
    return chat


def _content(part: Content, place: int) -> dict[str, Any]:
    match part:
        case ContentText():
            return {"type": "text", "text": part.text}
        case ContentImage():
            return {"type": "image_url", "image_url": {"url": part.image}, "place": place}
        case ContentReasoning() if part.redacted:
            return {"type": "reasoning", "summary": part.summary or "", "encrypted_content": part.reasoning}
        case ContentReasoning():
            return {"type": "reasoning", "reasoning": part.reasoning, "summary": part.summary or ""}
    kind = f"server_{part.type}" if part.type == "tool_use" else part.type
    return {**part.model_dump(mode="json", exclude_none=True), "type": kind, "place": place}
