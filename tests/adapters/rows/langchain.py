"""LangChain's agents and LangGraph's graphs with the middleware, its models as players, and the toolkit alone."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import partial
from typing import Any

from langchain.agents import create_agent
from langchain.agents.middleware import AgentMiddleware
from langchain.agents.structured_output import ToolStrategy
from langchain_core.callbacks import get_usage_metadata_callback
from langchain_core.messages import AIMessage, HumanMessage, RemoveMessage, ToolMessage
from langchain_core.tools import BaseTool, StructuredTool
from langgraph.graph import START, MessagesState, StateGraph
from langgraph.prebuilt import ToolNode, tools_condition
from smartplay_langchain import GraphSession, LangChainPlayer, SmartPlayMiddleware, SmartPlayToolkit
from smartplay_langchain.messages import usage_of

import smartplay_tools as sp
from tests.adapters.conformance import (
    EACH,
    GAME,
    SEED,
    WEATHER,
    Held,
    Host,
    Play,
    Replies,
    Send,
    Window,
    calling,
    direct,
    is_of_the_game,
    on_a_loop,
    waiting,
)
from tests.adapters.scripted_langchain import ScriptedModel
from tests.adapters.situations import AWAITED, LOOP, REFUSED, SCHEMA, lacking, weather


class LangChainAgent:
    """An agent of LangChain's or a graph of LangGraph's, and what a situation gives it beside the game."""

    def __init__(self, episode: sp.Episode, script: Replies, own_cap: int | None, situation: str) -> None:
        self.model = ScriptedModel(script, own_cap, EACH)
        self.middleware = SmartPlayMiddleware(episode)
        self.others: list[AgentMiddleware[Any, Any, Any]] = []
        self.tools: list[BaseTool] = []
        self.options: dict[str, Any] = {}
        self.runs = 1
        match situation:
            case "again":
                self.runs = 2
            case "another episode":
                self.tools = another_toolkit()
            case "another episode instead":
                self.others = [changing(tools=another_toolkit())]
            case "broken call" | "withdrawn":
                self.tools = [StructuredTool(**self.described(), args_schema=dict(WEATHER.parameters), func=weather)]
                self.others = [Withdraws()] if situation == "withdrawn" else []
            case "forgets":
                self.others = [Forgets()]
            case "no calls":
                self.others = [changing(tool_choice="none")]
            case "no tools":
                self.others = [changing(tools=[])]
            case "picture":
                self.tools = [StructuredTool.from_function(self.camera)]
            case "schema":
                self.options = {
                    "response_format": ToolStrategy(SCHEMA | {"title": "answer", "description": "An answer."})
                }
            case "sub-agent":
                self.tools = [StructuredTool.from_function(self.helper)]

    @staticmethod
    def described() -> dict[str, str]:
        return {"name": WEATHER.name, "description": WEATHER.description}

    @staticmethod
    def camera() -> list[dict[str, Any]]:
        """Take a picture."""
        image = {"type": "image", "base64": "AAAA", "mime_type": "image/png"}
        return [{"type": "text", "text": "Here."}, image]

    def helper(self) -> str:
        """Play for the agent."""
        return str(self.sub_agent().invoke({"messages": [HumanMessage("Play.")]})["messages"][-1].text)

    def sub_agent(self) -> Any:
        return create_agent(self.model, middleware=[self.middleware])

    def play(self, run: Callable[[], Any]) -> Held:
        state: Any = {"messages": []}
        words = ""
        with get_usage_metadata_callback() as callback:
            for _ in range(self.runs):
                try:
                    state = run()
                except sp.InvalidArgumentError as error:
                    if self.runs == 1:
                        raise
                    words = str(error)
        counts = callback.usage_metadata.get("scripted")
        usage = None if counts is None else usage_of(AIMessage("", usage_metadata=counts))
        return Held(self.model.received, usage, words or str(state["messages"][-1].text if state["messages"] else ""))


def another_toolkit() -> list[BaseTool]:
    return SmartPlayToolkit(episode=sp.Episode(GAME, seed=SEED + 1, context="host")).get_tools()


class Withdraws(AgentMiddleware[Any, Any, Any]):
    """Offers the weather for the first reply only."""

    def override(self, request: Any) -> Any:
        kept = [tool for tool in request.tools if tool.name != WEATHER.name or not request.messages]
        return request.override(tools=kept)

    def wrap_model_call(self, request: Any, handler: Any) -> Any:
        return handler(self.override(request))

    async def awrap_model_call(self, request: Any, handler: Any) -> Any:
        return await handler(self.override(request))


class Forgets(AgentMiddleware[Any, Any, Any]):
    """Keeps the latest reply and its results of five messages, as a summary of the agent's own does."""

    def before_model(self, state: Any, runtime: Any) -> dict[str, Any] | None:
        if len(messages := state["messages"]) < 5:
            return None
        return {"messages": [RemoveMessage(message.id) for message in messages[:-2]]}


def changing(**fields: Any) -> AgentMiddleware[Any, Any, Any]:
    """A middleware that changes the agent's requests."""

    class Changing(AgentMiddleware[Any, Any, Any]):
        def wrap_model_call(self, request: Any, handler: Any) -> Any:
            return handler(request.override(**fields))

        async def awrap_model_call(self, request: Any, handler: Any) -> Any:
            return await handler(request.override(**fields))

    return Changing()


def langchain_agent(
    episode: sp.Episode,
    script: Replies,
    *,
    own_cap: int | None = None,
    situation: str = "",
    asynchronously: bool = False,
) -> Held:
    host = LangChainAgent(episode, script, own_cap, situation)
    agent = create_agent(host.model, host.tools, middleware=[*host.others, host.middleware], **host.options)
    if asynchronously:
        return host.play(lambda: asyncio.run(agent.ainvoke({"messages": []})))
    return host.play(lambda: agent.invoke({"messages": []}))


def langgraph(episode: sp.Episode, script: Replies, *, own_cap: int | None = None, situation: str = "") -> Held:
    host = LangChainAgent(episode, script, own_cap, situation)
    session = GraphSession(episode, foreign_tools=host.tools)
    in_node = another_toolkit() if situation == "another episode instead" else [*session.tools, *host.tools]

    def after_speaking(state: MessagesState) -> str:
        if episode.done:
            return "__end__"
        return "tools" if getattr(state["messages"][-1], "tool_calls", ()) else "speak"

    def forget(state: MessagesState) -> dict[str, Any]:
        return Forgets().before_model(state, None) or {}

    def graph(*, ends_with_words: bool = False) -> Any:
        graph = StateGraph(MessagesState)
        graph.add_node("speak", lambda state: {"messages": session.ask(host.model, state["messages"])})
        graph.add_node("tools", ToolNode(in_node, wrap_tool_call=session.wrap_tool_call))
        graph.add_node("forget", forget if situation == "forgets" else lambda state: {})
        graph.add_edge(START, "speak")
        graph.add_conditional_edges("speak", tools_condition if ends_with_words else after_speaking)
        graph.add_edge("tools", "forget")
        graph.add_edge("forget", "speak")
        return graph.compile()

    host.sub_agent = partial(graph, ends_with_words=True)  # type: ignore[method-assign]
    return host.play(lambda: graph().invoke({"messages": []}, {"recursion_limit": 100}))


def langchain_player(
    episode: sp.Episode, script: Replies, *, play: Play, own_cap: int | None = None, situation: str = ""
) -> Held:
    model = ScriptedModel(script, own_cap)
    play(episode, LangChainPlayer(model))
    return Held(model.received)


def through_toolkit(episode: sp.Episode, *, asynchronously: bool = False) -> Send:
    tools = {tool.name: tool for tool in SmartPlayToolkit(episode=episode).get_tools()}

    async def send(name: str, arguments: Any) -> tuple[str, bool]:
        call = {"type": "tool_call", "id": "c0", "name": name, "args": arguments}
        message = await tools[name].ainvoke(call) if asynchronously else tools[name].invoke(call)
        return message.content, message.status == "error"

    return send


def through_toolkit_in_an_agent(episode: sp.Episode) -> Send:
    tools = SmartPlayToolkit(episode=episode).get_tools()

    async def send(name: str, arguments: Any) -> tuple[str, bool]:
        model = ScriptedModel([calling((name, arguments)), calling(say="I have seen it.")])
        state = await create_agent(model, tools).ainvoke({"messages": []})
        (message,) = [message for message in state["messages"] if isinstance(message, ToolMessage)]
        return message.content, message.status == "error"

    return send


TOOLKIT = "LangChain `SmartPlayToolkit` alone"
ONE_NODE = lacking(
    "the graph's node asks with the same tools, in messages", "no calls", "no tools", "schema", "withdrawn"
)
agent = partial(Window, through="LangChain `SmartPlayMiddleware`")
player = partial(Window, through="`play`, `aplay`", lacks=LOOP)

WINDOW = {
    "LangChain agent": agent(langchain_agent, refuses=REFUSED),
    "LangChain agent, async": agent(
        partial(langchain_agent, asynchronously=True), refuses=REFUSED, lacks=AWAITED, slow=True, repeats=True
    ),
    "LangChain player": player(partial(langchain_player, play=waiting)),
    "LangChain player, async": player(partial(langchain_player, play=on_a_loop), slow=True, repeats=True),
    "LangGraph": agent(langgraph, lacks=ONE_NODE),
}
HOST = {
    "LangChain toolkit": Host(partial(direct, send_to=through_toolkit), TOOLKIT, is_of_the_game),
    "LangChain toolkit, async": Host(
        partial(direct, send_to=partial(through_toolkit, asynchronously=True)), TOOLKIT, is_of_the_game
    ),
    "LangChain toolkit in an agent": Host(
        partial(direct, send_to=through_toolkit_in_an_agent), TOOLKIT, is_of_the_game
    ),
}
