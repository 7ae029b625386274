"""A LangChain chat model that replies with a script, and stores what it was sent."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from inspect import signature
from typing import Any

import pytest
from langchain.agents.middleware import AgentMiddleware, HumanInTheLoopMiddleware
from langchain_core.language_models import BaseChatModel
from langchain_core.messages import BaseMessage, HumanMessage
from langchain_core.messages.ai import UsageMetadata
from langchain_core.outputs import ChatGeneration, ChatResult
from langchain_core.utils.function_calling import convert_to_openai_tool
from langgraph.graph import START, MessagesState, StateGraph
from langgraph.prebuilt import ToolNode
from smartplay_langchain import GraphSession, from_langchain, to_langchain

from tests.adapters.conformance import Received

needs_single_approvals = pytest.mark.skipif(
    "interrupt_mode" not in signature(HumanInTheLoopMiddleware).parameters,
    reason="this version of LangChain approves all calls of a message at once",
)


class ScriptedModel(BaseChatModel):
    script: Iterator[Any]
    sent: list[Any]
    settings: list[dict[str, Any]]
    max_tokens: int | None = None
    """The user's own cap on replies, which a request's replaces."""
    usage: Any = None
    """The `sp.Usage` that each reply reports."""

    def __init__(self, script: Iterable[Any], max_tokens: int | None = None, usage: Any = None) -> None:
        own = {} if max_tokens is None else {"max_tokens": max_tokens}
        super().__init__(script=iter(script), sent=[], settings=[], usage=usage, **own)

    @property
    def received(self) -> list[Received]:
        """What the model was sent, in canonical form."""
        requests = []
        for messages, settings in zip(self.sent, self.settings, strict=True):
            functions = [convert_to_openai_tool(tool)["function"] for tool in settings.get("tools", ())]
            tools = [(function["name"], function["description"], function["parameters"]) for function in functions]
            requests.append(Received(messages, tools, settings.get("max_tokens", self.max_tokens)))
        return requests

    @property
    def _llm_type(self) -> str:
        return "scripted"

    def bind_tools(self, tools: Any, **kwargs: Any) -> Any:
        return self.bind(tools=tools, **kwargs)

    def _generate(self, messages: list[BaseMessage], stop: Any = None, run_manager: Any = None, **kwargs: Any) -> Any:
        self.sent.append([dict(from_langchain(message)) for message in messages])
        self.settings.append(kwargs)
        (reply,) = to_langchain([next(self.script)])
        if (usage := self.usage) is not None:
            counts = {
                "input_tokens": usage.prompt,
                "output_tokens": usage.reply,
                "total_tokens": usage.prompt + usage.reply,
            }
            reply.usage_metadata = UsageMetadata(**counts, input_token_details={"cache_read": usage.cached})
            reply.response_metadata["model_name"] = "scripted"
        return ChatResult(generations=[ChatGeneration(message=reply)])


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
