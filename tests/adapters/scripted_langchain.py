"""A LangChain chat model that replies with a script, and stores what it was sent."""

from __future__ import annotations

from collections.abc import Iterable
from inspect import signature
from typing import Any

import pytest
from langchain.agents.middleware import AgentMiddleware, HumanInTheLoopMiddleware
from langchain_core.messages import HumanMessage
from langgraph.graph import START, MessagesState, StateGraph
from langgraph.prebuilt import ToolNode
from smartplay_langchain import GraphSession, PlayerChatModel

import smartplay_tools as sp
from tests.adapters.conformance import Received, received

needs_single_approvals = pytest.mark.skipif(
    "interrupt_mode" not in signature(HumanInTheLoopMiddleware).parameters,
    reason="this version of LangChain approves all calls of a message at once",
)


class ScriptedModel(PlayerChatModel):
    """Replies with a script; `max_tokens` is the user's own cap on replies, which a request's replaces."""

    def __init__(self, script: Iterable[Any], max_tokens: int | None = None, usage: sp.Usage | None = None) -> None:
        own = {} if max_tokens is None else {"max_tokens": max_tokens}
        super().__init__(player=sp.ScriptedPlayer(script, usage), **own)

    def bind_tools(self, tools: Any, *, tool_choice: Any = None, **settings: Any) -> Any:
        """A player is shown the tools that it may call; this model is shown all that it is sent."""
        return super().bind_tools(tools, **settings)

    @property
    def received(self) -> list[Received]:
        """What the model was sent, in canonical form."""
        return list(map(received, self.player.prompts))


class Reminder(AgentMiddleware[Any, Any, Any]):
    """Adds a message to every request, which is in no state."""

    def __init__(self, words: str) -> None:
        super().__init__()
        self.words = words

    def wrap_model_call(self, request: Any, handler: Any) -> Any:
        return handler(request.override(messages=[*request.messages, HumanMessage(self.words)]))

    async def awrap_model_call(self, request: Any, handler: Any) -> Any:
        return await handler(request.override(messages=[*request.messages, HumanMessage(self.words)]))


def playing_graph(session: GraphSession, speak: Any, **options: Any) -> Any:
    """A graph of LangGraph's that plays to the end: `speak` asks the model, in a node with these options."""

    def after_speaking(state: MessagesState) -> str:
        if session.episode.done:
            return "__end__"
        return "tools" if getattr(state["messages"][-1], "tool_calls", ()) else "speak"

    graph = StateGraph(MessagesState)
    graph.add_node("speak", speak, **options)
    graph.add_node("tools", ToolNode(session.tools, wrap_tool_call=session.wrap_tool_call))
    graph.add_edge(START, "speak")
    graph.add_conditional_edges("speak", after_speaking)
    graph.add_edge("tools", "speak")
    return graph.compile()
