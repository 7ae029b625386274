"""SmartPlayMiddleware: plays an episode in a LangChain agent, with the agent's model.

`wrap_model_call` puts a stand-in for the model into the request, which makes the prompt when the request reaches it, so
that the window is applied after all other middlewares. The calls of the reply go through the agent's tool node, where
they can be approved, edited, limited and traced, and are played in the order of the message. `before_model` takes over
what the middlewares did, and ends the run with the episode. `after_model` continues the run where LangChain would stop:
after a reply without a call, and after calls whose arguments do not parse.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, Any, cast

from smartplay_tools.errors import extra_named
from smartplay_tools.players.cache_marks import CacheMarks

with extra_named("SmartPlayMiddleware", "langchain"):
    from langchain.agents.middleware import (
        AgentMiddleware,
        AgentState,
        ModelRequest,
        ModelResponse,
        hook_config,
    )
    from langchain_core.messages import AIMessage, BaseMessage

from smartplay_langchain.asking import OVER, ToolChoice, WindowedModel
from smartplay_langchain.calls import turn_of
from smartplay_langchain.graph import GraphSession
from smartplay_tools import AgentSession, Episode, InvalidArgumentError

if TYPE_CHECKING:
    from langchain_core.language_models import BaseChatModel

Handler = Callable[[ModelRequest[Any]], ModelResponse[Any]]
AsyncHandler = Callable[[ModelRequest[Any]], Awaitable[ModelResponse[Any]]]


class SmartPlayMiddleware(GraphSession, AgentMiddleware[AgentState[Any], Any, Any]):
    """Plays one episode in one agent, which gets the game's tools from it: a `GraphSession` whose graph is the agent.

    The arguments are those of `GraphSession`; the agent's other tools are known from its requests.
    """

    def __init__(
        self,
        episode: Episode | AgentSession,
        *,
        player: str = "langchain",
        limit_field: str = "max_tokens",
        summary_tool_choice: ToolChoice = "none",
        cache: CacheMarks = True,
        pictures: bool = False,
    ) -> None:
        super().__init__(
            episode,
            player=player,
            limit_field=limit_field,
            summary_tool_choice=summary_tool_choice,
            cache=cache,
            pictures=pictures,
        )

    @hook_config(can_jump_to=["end"])
    def before_model(self, state: AgentState[Any], runtime: Any) -> dict[str, Any] | None:
        """Take over what has happened since the latest reply; end the run when the episode is over."""
        if self.is_asked_by_sub_agent:
            return {"messages": [AIMessage(self.episode.words("sub_agent"))], "jump_to": "end"}
        if self.recorded_reply(state["messages"]) is not None:
            return None
        changed: dict[str, Any] = {"messages": self.update(state["messages"])}
        return {**changed, "jump_to": "end"} if self.episode.done else changed

    @hook_config(can_jump_to=["end"])
    async def abefore_model(self, state: AgentState[Any], runtime: Any) -> dict[str, Any] | None:
        """Do what `before_model` does, without blocking the event loop."""
        return await asyncio.to_thread(self.before_model, state, runtime)

    def wrap_model_call(self, request: ModelRequest[Any], handler: Handler) -> ModelResponse[Any]:
        """Have the model called with the window, after a summary where one is owed, and take its reply."""
        if (response := self._known(request)) is not None:
            return response
        windowed = self.windowed(request.model, request.state["messages"])
        response = handler(request.override(model=cast("BaseChatModel", windowed)))
        return self._received(windowed, response)

    async def awrap_model_call(self, request: ModelRequest[Any], handler: AsyncHandler) -> ModelResponse[Any]:
        """Do what `wrap_model_call` does, without blocking the event loop."""
        if (response := self._known(request)) is not None:
            return response
        windowed = self.windowed(request.model, request.state["messages"])
        response = await handler(request.override(model=cast("BaseChatModel", windowed)))
        return await asyncio.to_thread(self._received, windowed, response)

    @hook_config(can_jump_to=["model"])
    def after_model(self, state: AgentState[Any], runtime: Any) -> dict[str, Any] | None:
        """Call the model again after a reply without a call that LangChain would run, unless the episode is over."""
        reply = next(message for message in reversed(state["messages"]) if isinstance(message, AIMessage))
        if turn_of(reply) is None:
            self._stopped(reply)
            return None
        return None if reply.tool_calls or self.episode.done else {"jump_to": "model"}

    def after_agent(self, state: AgentState[Any], runtime: Any) -> dict[str, Any] | None:
        """Record what another middleware did when it ended the run, and why."""
        messages = state["messages"]
        if self.episode.done or not messages or self.is_asked_by_sub_agent:
            return None
        added = self.update(messages)
        if isinstance(messages[-1], AIMessage) and turn_of(messages[-1]) is None:
            self._stopped(messages[-1])
        return {"messages": added}

    async def aafter_agent(self, state: AgentState[Any], runtime: Any) -> dict[str, Any] | None:
        """Do what `after_agent` does, without blocking the event loop."""
        return await asyncio.to_thread(self.after_agent, state, runtime)

    def _known(self, request: ModelRequest[Any]) -> ModelResponse[Any] | None:
        """Return a reply that the record has and the graph's state has not, or the end of the episode."""
        if request.response_format is not None:
            raise InvalidArgumentError("An agent that plays cannot have a response_format: its run ends with the game.")
        messages: list[BaseMessage] = list(request.state["messages"])
        recorded = self.recorded_reply(messages)
        if recorded is None and self.episode.done:
            return ModelResponse(result=[OVER])
        return None if recorded is None else ModelResponse(result=list(recorded))

    def _received(self, asked: WindowedModel, response: ModelResponse[Any]) -> ModelResponse[Any]:
        reply = next((message for message in response.result if isinstance(message, AIMessage)), None)
        if asked.is_over or reply is None:
            return response
        if asked.reply is not None and reply.id == asked.reply.source.id:
            return ModelResponse(result=list(self.receive(asked, reply)))
        if reply.id is not None:
            raise InvalidArgumentError(
                "A reply came from a model that the window was not applied to. Put the middleware that chooses it "
                "(ModelFallbackMiddleware, for example) before SmartPlayMiddleware."
            )
        return response

    def _stopped(self, message: AIMessage) -> None:
        """Take note of a reply that a middleware made up: instead of the model's, which failed, or to end the run."""
        if self.session is None or self.episode.done:
            return
        reason, error, _ = self.episode.if_closed or (None, None, None)
        if reason == "player_error":
            self.episode.end(reason, error)
        else:
            self.session.halt(str(message.text))
