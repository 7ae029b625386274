"""The context manager in LangChain: for an agent that exists, and for a model in a graph built by hand.

A stand-in takes the model's place, so that the prompt is made when the request reaches the model: after all
middlewares, with the tools and the output schema that are sent. What it sends is not stored: the agent's state keeps
every message.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Mapping, Sequence
from typing import Any, TypeAlias, cast

from smartplay_tools.errors import extra_named

with extra_named("ContextManagerMiddleware", "langchain"):
    from langchain.agents.middleware import AgentMiddleware, AgentState, ModelRequest, ModelResponse
    from langchain_core.language_models import BaseChatModel, LanguageModelInput
    from langchain_core.messages import AIMessage, BaseMessage, ToolMessage, convert_to_messages
    from langchain_core.runnables import Runnable, RunnableConfig
    from langchain_core.tools import BaseTool
    from langchain_core.utils.function_calling import convert_to_openai_tool

from smartplay_langchain.asking import StandIn
from smartplay_tools import ContextManager, FittedPrompt, InvalidArgumentError
from smartplay_tools.players import asks_management
from smartplay_tools.players.conversion import function_call

Handler = Callable[[ModelRequest[Any]], ModelResponse[Any]]
AsyncHandler = Callable[[ModelRequest[Any]], Awaitable[ModelResponse[Any]]]
Config: TypeAlias = "RunnableConfig | None"


_PASSING_BY = ("generate", "agenerate", "generate_prompt", "agenerate_prompt")
"""The methods of a chat model that send a prompt and are no runnable's."""

_ROLES = {"ai": "assistant", "human": "user", "system": "system", "tool": "tool"}
_CALLS = ("tool_calls", "function_call")
"""The fields of a reply in which providers' packages repeat its calls."""


class ContextManagerMiddleware(AgentMiddleware[AgentState[Any], Any, Any]):
    """Holds every request of an agent to the budget of a `ContextManager`.

        manager = sp.ContextManager(prompt_tokens=8_000)
        agent = create_agent(model, tools, middleware=[ContextManagerMiddleware(manager)])

    Its place among other middlewares does not matter.
    """

    def __init__(self, manager: ContextManager) -> None:
        super().__init__()
        self.manager = manager

    def wrap_model_call(self, request: ModelRequest[Any], handler: Handler) -> ModelResponse[Any]:
        """Have the model called with what fits."""
        return handler(request.override(model=cast("BaseChatModel", FittedModel(request.model, self.manager))))

    async def awrap_model_call(self, request: ModelRequest[Any], handler: AsyncHandler) -> ModelResponse[Any]:
        """Do what `wrap_model_call` does."""
        return await handler(request.override(model=cast("BaseChatModel", FittedModel(request.model, self.manager))))


class FittedModel(StandIn):
    """Takes the place of a chat model, and sends it what a context manager shows of the messages.

    model = FittedModel(init_chat_model("..."), sp.ContextManager(prompt_tokens=8_000))
    reply = model.bind_tools(tools).invoke(messages)
    """

    def __init__(self, model: BaseChatModel, manager: ContextManager) -> None:
        super().__init__(model)
        self.manager = manager

    def request(
        self, tools: Sequence[BaseTool | dict[str, Any]], settings: dict[str, Any]
    ) -> Runnable[LanguageModelInput, AIMessage]:
        """Return a runnable that fits messages and sends them with these tools and settings."""
        bound = self._model.bind_tools(tools, **settings) if tools else self._model.bind(**settings)
        schemas = [tool if isinstance(tool, dict) else convert_to_openai_tool(tool) for tool in tools]
        return _Fitted(bound, self.manager, schemas, settings.get("response_format"))

    def with_structured_output(self, schema: Any, **settings: Any) -> Runnable[Any, Any]:
        """Do what the model's own does, with the requests that it makes held to the budget."""
        return type(self._model).with_structured_output(cast("BaseChatModel", self), schema, **settings)

    def __or__(self, other: Any) -> Runnable[Any, Any]:
        """Return a chain that begins with this model."""
        chain: Runnable[Any, Any] = self.request((), {}) | other
        return chain

    def __getattr__(self, name: str) -> Any:
        """Return what the model has; whatever would send a prompt by itself sends it as `request` does."""
        if name in _PASSING_BY:
            raise InvalidArgumentError(f"{name} would pass by the budget; use invoke, stream or batch.")
        return getattr(self.request((), {}) if hasattr(Runnable, name) else self._model, name)


class _Fitted(Runnable[LanguageModelInput, AIMessage]):
    """A bound model behind a context manager."""

    def __init__(self, bound: Runnable[Any, AIMessage], manager: ContextManager, tools: list[Any], schema: Any) -> None:
        self._bound, self._manager, self._tools, self._schema = bound, manager, tools, schema

    def invoke(self, input: Any, config: Config = None, **settings: Any) -> AIMessage:  # noqa: A002
        """Send what fits."""
        prompt, messages = self._fitted(input, settings)
        return self._told(prompt, self._bound.invoke(messages, config, **settings), settings)

    async def ainvoke(self, input: Any, config: Config = None, **settings: Any) -> AIMessage:  # noqa: A002
        """Send what fits."""
        prompt, messages = await self._afitted(input, settings)
        return self._told(prompt, await self._bound.ainvoke(messages, config, **settings), settings)

    def stream(self, input: Any, config: Config = None, **settings: Any) -> Iterator[AIMessage]:  # noqa: A002
        """Send what fits, and yield the reply in pieces."""
        prompt, messages = self._fitted(input, settings)
        for piece in self._bound.stream(messages, config, **settings):
            yield self._told(prompt, piece, settings)

    async def astream(self, input: Any, config: Config = None, **settings: Any) -> AsyncIterator[AIMessage]:  # noqa: A002
        """Send what fits, and yield the reply in pieces."""
        prompt, messages = await self._afitted(input, settings)
        async for piece in self._bound.astream(messages, config, **settings):
            yield self._told(prompt, piece, settings)

    def _told(self, prompt: FittedPrompt, reply: AIMessage, settings: Mapping[str, Any]) -> AIMessage:
        """Have the prompt's tokens recorded as the provider has counted them."""
        if reply.usage_metadata is not None and (tokens := reply.usage_metadata["input_tokens"]):
            model = vars(getattr(self._bound, "bound", self._bound))
            managed = asks_management(settings, getattr(self._bound, "kwargs", None), model)
            self._manager.reported(prompt, tokens, managed=managed)
        return reply

    def _fitted(self, given: Any, settings: Mapping[str, Any]) -> tuple[FittedPrompt, list[BaseMessage]]:
        messages, request = self._request(given, settings)
        prompt = self._manager.fit(as_chats(messages), **request)
        return prompt, as_given(prompt, messages)

    async def _afitted(self, given: Any, settings: Mapping[str, Any]) -> tuple[FittedPrompt, list[BaseMessage]]:
        messages, request = self._request(given, settings)
        prompt = await self._manager.afit(as_chats(messages), **request)
        return prompt, as_given(prompt, messages)

    def _request(self, given: Any, settings: Mapping[str, Any]) -> tuple[list[BaseMessage], dict[str, Any]]:
        """The messages of a request, and what counts beside them."""
        messages = convert_to_messages([given] if isinstance(given, str) else given)
        schema = settings.get("response_format", self._schema)
        return messages, {"tools": self._tools, "output_schema": schema, "form": "chat"}


def as_given(prompt: FittedPrompt, given: Sequence[BaseMessage]) -> list[BaseMessage]:
    """Return a fitted prompt in LangChain's messages: those that were given, and copies of those that are shorter."""
    shorter, trimmed = {*prompt.masked, *prompt.elided, *prompt.cut, *prompt.rewritten}, {*prompt.trimmed}
    shown: list[BaseMessage] = []
    for source, message in zip(prompt.sources, prompt.messages, strict=True):
        if source is None:
            shown += convert_to_messages([message])
        elif source in trimmed:
            shown.append(given[source].model_copy(update={"content": "", "additional_kwargs": {}}))
        elif source in shorter:
            shown.append(given[source].model_copy(update={"content": message["content"]}))
        else:
            shown.append(given[source])
    return shown


def as_chats(messages: Sequence[BaseMessage]) -> list[Mapping[str, Any]]:
    """Return messages in the chat form."""
    return [as_chat(message, number) for number, message in enumerate(messages)]


def as_chat(message: BaseMessage, number: int) -> Mapping[str, Any]:
    """Return a message in the chat form, with everything that is sent of it; `number` is its position."""
    role = getattr(message, "role", None) or _ROLES.get(message.type.removesuffix("MessageChunk").lower())
    if role is None:
        raise InvalidArgumentError(f"Message {number} has the type {message.type!r}, which no prompt can have.")
    chat: dict[str, Any] = {"role": role, "content": message.content}
    if message.name:
        chat["name"] = message.name
    more = {name: value for name, value in message.additional_kwargs.items() if name not in _CALLS}
    if more:
        chat["more"] = more
    if isinstance(message, ToolMessage):
        chat["tool_call_id"] = message.tool_call_id
    if isinstance(message, AIMessage) and (message.tool_calls or message.invalid_tool_calls):
        calls = [*message.tool_calls, *message.invalid_tool_calls]
        chat["tool_calls"] = [function_call(call["id"] or "", call["name"] or "", call["args"]) for call in calls]
    return chat
