"""Asking the model: a stand-in for the model in an agent's requests, so that the window is applied last of all.

Middlewares wrap each other, and any of them may change what the model is sent. `WindowedModel` takes the place of the
request's model: the prompt is made when the request reaches it, whatever the order of the middlewares. Texts that they
have added are then part of the prompt, counted and recorded, and messages that they have removed or cut have no effect.

A window that owes a summary has the model called once more, by the same request and before the reply to play:
middlewares see one request and one reply.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, TypeAlias
from uuid import uuid4

from langchain_core.language_models import BaseChatModel, LanguageModelInput
from langchain_core.messages import AIMessage, AnyMessage, BaseMessage, SystemMessage
from langchain_core.runnables import Runnable, RunnableConfig
from langchain_core.tools import BaseTool
from langchain_core.utils.function_calling import convert_to_openai_tool

from smartplay_langchain.caching import cache_key, messages_for
from smartplay_langchain.messages import from_langchain, to_langchain, usage_of
from smartplay_tools import AgentSession, InvalidArgumentError, Prompt, Reply, ToolSpec
from smartplay_tools.players import reply_in
from smartplay_tools.players.cache_marks import CacheMarks

Tools = Sequence[BaseTool | dict[str, Any]]

Asked: TypeAlias = Runnable[LanguageModelInput, AIMessage]

ToolChoice = str | Mapping[str, Any]
"""A value of a model's setting `tool_choice`."""


@dataclass(frozen=True)
class PromptSettings:
    """How a prompt becomes a request, in the terms of the model's provider."""

    limit_field: str = "max_tokens"
    """The name of the model's parameter for the cap on a reply."""
    summary_tool_choice: ToolChoice = "none"
    """The model's `tool_choice` where it must not call a tool."""
    cache: CacheMarks = True
    """What is marked for the provider's cache."""

    def request(
        self, prompt: Prompt, model: BaseChatModel, tools: Tools, own: Mapping[str, Any] = MappingProxyType({})
    ) -> tuple[Asked, list[AnyMessage]]:
        """Return the model with a prompt's settings, and the prompt's messages for it.

        Arguments:
            prompt: the prompt.
            model: the model; a cap that it was made with counts, too.
            tools: the tools of the request, of which the prompt's are offered, in its order.
            own: the settings of the request.
        """
        settings = dict(own)
        if self.limit_field in model.model_fields_set:
            settings.setdefault(self.limit_field, getattr(model, self.limit_field))
        if self.cache:
            settings |= cache_key(prompt, model, settings)
        settings = prompt.settings(settings, cap=self.limit_field, no_tools=self.summary_tool_choice)
        by_name = {spec_of(tool).name: tool for tool in tools}
        offered = [by_name[spec.name] for spec in prompt.tools]
        bound = model.bind_tools(offered, **settings) if offered else model.bind(**settings)
        if prompt.purpose != "play":
            bound = bound.with_config(tags=[SUMMARY_TAG])
        return bound, messages_for(prompt, model, self.cache, own)


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelReply(Reply):
    """A reply, and the message of LangChain's that it was read from."""

    source: AIMessage


Prepare = Callable[[Sequence[SystemMessage], Sequence[BaseMessage], Tools], AgentSession]
"""Prepares the session for its next prompt, given the system texts, the messages that are not in the state, and the
tools of the request."""


def read_reply(message: AIMessage) -> ModelReply:
    """Return a model's message as a reply."""
    return ModelReply(from_langchain(message), usage_of(message), source=message)


def read_error(error: Exception) -> ModelReply:
    """Return the reply that a model's error was, where a server could not read its call; raise any other."""
    reply = reply_in(error)
    (source,) = to_langchain([reply.message])
    assert isinstance(source, AIMessage)
    return ModelReply(reply.message, reply.usage, source=source.model_copy(update={"id": f"error-{uuid4()}"}))


class StandIn:
    """Takes the place of a chat model. Everything but the calls that lead to a reply is the model's own."""

    def __init__(self, model: BaseChatModel) -> None:
        self._model = model

    @property  # type: ignore[misc]
    def __class__(self) -> Any:
        """The class of the model, by which middlewares know its provider."""
        return type(self._model)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._model, name)

    def request(self, tools: Tools, settings: dict[str, Any]) -> Asked:
        """Return a runnable that makes a prompt and sends it with these tools and settings."""
        raise NotImplementedError

    def bind_tools(self, tools: Tools, **settings: Any) -> Asked:
        """Return a runnable that makes a prompt and sends it, with these tools and settings."""
        return self.request(tools, settings)

    def bind(self, **settings: Any) -> Asked:
        """Return a runnable that makes a prompt and sends it, with these settings and no tools."""
        return self.request((), settings)


class WindowedModel(StandIn):
    """Replaces a chat model in a request of an agent that plays.

    Arguments:
        model: the model of the request.
        state: the messages in the state.
        prepare: prepares the session for its next prompt.
        prompt_settings: how a prompt becomes a request.
    """

    def __init__(
        self,
        model: BaseChatModel,
        state: Sequence[BaseMessage],
        prepare: Prepare,
        prompt_settings: PromptSettings,
    ) -> None:
        super().__init__(model)
        self._state, self._prepare = state, prepare
        self._prompt_settings = prompt_settings
        self.reply: ModelReply | None = None
        """The latest reply of the model; None if there was none."""
        self.discarded: list[ModelReply] = []
        """Earlier replies, which a middleware discarded to ask again."""
        self.is_over = False
        """Whether there was no further prompt, so that the model was not asked."""

    def request(self, tools: Tools, settings: dict[str, Any]) -> Asked:
        """Return a runnable that sends the window to the model, with these tools and settings."""
        return _Request(self, tools, settings)


class _Request(Runnable[LanguageModelInput, AIMessage]):
    """The innermost request of an agent: it makes the prompt and sends it."""

    def __init__(self, stand_in: WindowedModel, tools: Tools, settings: dict[str, Any]) -> None:
        self._stand_in, self._tools, self._settings = stand_in, tools, settings

    def invoke(self, input: Any, config: RunnableConfig | None = None, **_: Any) -> AIMessage:  # noqa: A002
        """Send the prompt."""

        def send(prompt: Prompt) -> ModelReply:
            try:
                model, messages = self._request(prompt)
                return read_reply(model.invoke(messages, config))
            except Exception as error:
                return read_error(error)

        return self._replied(self._prepared(input).ask(send))

    async def ainvoke(self, input: Any, config: RunnableConfig | None = None, **_: Any) -> AIMessage:  # noqa: A002
        """Send the prompt without blocking the event loop."""
        import asyncio

        async def send(prompt: Prompt) -> ModelReply:
            try:
                model, messages = self._request(prompt)
                return read_reply(await model.ainvoke(messages, config))
            except Exception as error:
                return read_error(error)

        session = await asyncio.to_thread(self._prepared, input)
        return self._replied(await session.aask(send))

    def _prepared(self, sent: Sequence[BaseMessage]) -> AgentSession:
        stand_in = self._stand_in
        added = _added(sent, stand_in._state)
        system = [message for message in (*sent[:1], *added) if isinstance(message, SystemMessage)]
        others = [message for message in added if not isinstance(message, SystemMessage)]
        return stand_in._prepare(_once(system), others, self._tools)

    def _replied(self, reply: ModelReply | None) -> AIMessage:
        asked = self._stand_in
        asked.is_over = reply is None
        if reply is None:
            return OVER
        if asked.reply is not None:
            asked.discarded.append(asked.reply)
        asked.reply = reply
        return reply.source

    def _request(self, prompt: Prompt) -> tuple[Asked, list[AnyMessage]]:
        asked = self._stand_in
        return asked._prompt_settings.request(prompt, asked._model, self._tools, self._settings)


SUMMARY_TAG = "smartplay-summary"
"""The tag of the model's runs that write summaries, by which callbacks and streams can tell them apart."""

OVER = AIMessage("The episode is over.")
"""The reply that an agent gets if there is no further prompt, because it expects one."""


def spec_of(tool: BaseTool | dict[str, Any]) -> ToolSpec:
    """Return a tool as it is counted; one that the provider runs is an `InvalidArgumentError`."""
    function = convert_to_openai_tool(tool).get("function")
    if function is None:
        kind = tool.get("type") if isinstance(tool, dict) else getattr(tool, "name", tool)
        raise InvalidArgumentError(
            f"The tool {kind!r} is run by the provider, and what it adds to a prompt cannot be counted; leave it out."
        )
    return ToolSpec(function["name"], function.get("description", ""), function.get("parameters", {}))


def _added(sent: Sequence[BaseMessage], state: Sequence[BaseMessage]) -> list[BaseMessage]:
    """The messages of a request that are not in the state, a system text at the beginning apart."""
    messages = sent[1:] if sent and isinstance(sent[0], SystemMessage) else sent
    if len(messages) == len(state) and all(map(operator.is_, messages, state)):
        return []
    ids, same = {message.id for message in state if message.id}, set(map(id, state))
    return [message for message in messages if id(message) not in same and message.id not in ids]


def _once(messages: Sequence[SystemMessage]) -> list[SystemMessage]:
    return list({id(message): message for message in messages}.values())
