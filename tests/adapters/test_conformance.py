"""The conversation of `conformance.py` through every adapter. A new adapter is one more row."""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import AsyncIterator, Callable, Iterable, Sequence
from contextlib import AsyncExitStack, ExitStack, asynccontextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import httpx2
import pytest
from agents import (
    Agent,
    AgentOutputSchema,
    MaxTurnsExceeded,
    ModelSettings,
    Runner,
    Tool,
    ToolOutputImage,
    ToolOutputText,
    function_tool,
    set_tracing_disabled,
)
from langchain.agents import create_agent
from langchain.agents.middleware import AgentMiddleware
from langchain.agents.structured_output import ToolStrategy
from langchain_core.callbacks import get_usage_metadata_callback
from langchain_core.messages import AIMessage, HumanMessage, RemoveMessage, ToolMessage
from langchain_core.tools import StructuredTool
from langgraph.graph import START, MessagesState, StateGraph
from langgraph.prebuilt import ToolNode, tools_condition
from mcp import Client, StdioServerParameters, stdio_client
from mcp.client.streamable_http import streamable_http_client
from smartplay_anthropic import AnthropicPlayer
from smartplay_langchain import GraphSession, LangChainPlayer, SmartPlayMiddleware, SmartPlayToolkit
from smartplay_langchain.messages import usage_of
from smartplay_mcp import HttpServer, game_server
from smartplay_openai import OpenAIPlayer, ResponsesPlayer, WindowEndpoint
from smartplay_openai.agents import SmartPlayModel

import smartplay_tools as sp
from smartplay_tools.players import ModelPlayer
from smartplay_tools.web import EpisodeStore, HostedEpisode
from tests.adapters import conformance, situations
from tests.adapters.anthropic_stub import AnthropicStub
from tests.adapters.conformance import (
    BASIC,
    BROKEN,
    BUDGETS,
    EACH,
    GAME,
    HOST_BUDGET,
    HOSTS,
    IDLE,
    OURS,
    WEATHER,
    Held,
    Host,
    Send,
    Turns,
    Window,
    calling,
    host_episode,
    line_of,
    table,
)
from tests.adapters.openai_stub import OpenAIStub
from tests.adapters.scripted_agents import ReadingModel
from tests.adapters.scripted_langchain import ScriptedModel
from tests.adapters.situations import SCHEMA, lacking
from tests.adapters.window_host import INTERFACES, TOOLS, HostAgent, client_of, play_through

Script = Iterable[sp.Message]


@pytest.fixture(autouse=True)
def _no_traces() -> None:
    """No traces to a provider."""
    set_tracing_disabled(True)


# --- Adapters that manage the context ----------------------------------------------------------------------------


def weather(city: str = "") -> str:
    """Tell the weather."""
    raise AssertionError("its arguments are not JSON")


PICTURE = "data:image/png;base64,AAAA"
NO_GAME_TOOLS = "has the game's tools|has removed act, observe, read_manual"


class LangChainAgent:
    """An agent of LangChain's or a graph of LangGraph's, and what a situation gives it beside the game."""

    def __init__(self, episode: sp.Episode, script: Script, own_cap: int | None, situation: str) -> None:
        self.model = ScriptedModel(script, own_cap, EACH)
        self.middleware = SmartPlayMiddleware(episode)
        self.others: list[AgentMiddleware[Any, Any, Any]] = []
        self.tools: list[StructuredTool] = []
        self.options: dict[str, Any] = {}
        self.runs = 1
        match situation:
            case "again":
                self.runs = 2
            case "broken call":
                self.tools = [StructuredTool(**self.described(), args_schema=dict(WEATHER.parameters), func=weather)]
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
    script: Script,
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


def langgraph(episode: sp.Episode, script: Script, *, own_cap: int | None = None, situation: str = "") -> Held:
    host = LangChainAgent(episode, script, own_cap, situation)
    session = GraphSession(episode, foreign_tools=host.tools)

    def after_speaking(state: MessagesState) -> str:
        if episode.done:
            return "__end__"
        return "tools" if getattr(state["messages"][-1], "tool_calls", ()) else "speak"

    def forget(state: MessagesState) -> dict[str, Any]:
        return Forgets().before_model(state, None) or {}

    def graph(*, ends_with_words: bool = False) -> Any:
        graph = StateGraph(MessagesState)
        graph.add_node("speak", lambda state: {"messages": session.ask(host.model, state["messages"])})
        graph.add_node("tools", ToolNode([*session.tools, *host.tools], wrap_tool_call=session.wrap_tool_call))
        graph.add_node("forget", forget if situation == "forgets" else lambda state: {})
        graph.add_edge(START, "speak")
        graph.add_conditional_edges("speak", tools_condition if ends_with_words else after_speaking)
        graph.add_edge("tools", "forget")
        graph.add_edge("forget", "speak")
        return graph.compile()

    host.sub_agent = partial(graph, ends_with_words=True)  # type: ignore[method-assign]
    return host.play(lambda: graph().invoke({"messages": []}, {"recursion_limit": 100}))


def agents_sdk(
    episode: sp.Episode, script: Script, *, own_cap: int | None = None, situation: str = "", streamed: bool = False
) -> Held:
    inner = ReadingModel(script, EACH)
    model = SmartPlayModel(inner, episode)
    settings = ModelSettings(max_tokens=own_cap, tool_choice="none" if situation == "no calls" else None)

    @function_tool
    def camera() -> Any:
        """Take a picture."""
        return [ToolOutputText(text="Here."), ToolOutputImage(image_url=PICTURE)]

    @function_tool
    async def helper() -> str:
        """Play for the agent."""
        other = Agent("helper", model=model, tools=model.tools)
        return str((await Runner.run(other, "Play.", run_config=model.run_config)).final_output)

    weather_tool = replace(
        function_tool(weather, name_override=WEATHER.name, strict_mode=False),
        description=WEATHER.description,
        params_json_schema=dict(WEATHER.parameters),
    )
    own: dict[str, list[Tool]] = {"broken call": [weather_tool], "picture": [camera], "sub-agent": [helper]}
    tools = [] if situation == "no tools" else [*model.tools, *own.get(situation, [])]
    output = AgentOutputSchema(dict[str, int], strict_json_schema=False) if situation == "schema" else None
    agent = Agent("player", model=model, tools=tools, model_settings=settings, output_type=output)

    async def run(items: list[Any], most: int | None = None) -> Any:
        if not streamed:
            return await Runner.run(agent, items, max_turns=most, run_config=model.run_config)
        running = Runner.run_streamed(agent, items, max_turns=most, run_config=model.run_config)
        async for _ in running.stream_events():
            pass
        return running

    async def runs() -> Any:
        if situation == "forgets":  # what it said before the latest reply
            with pytest.raises(MaxTurnsExceeded) as stopped:
                await run([], 3)
            items = [item.to_input_item() for item in stopped.value.run_data.new_items]
            return await run(items[-2:])
        result = await run([])
        return await run([]) if situation == "again" else result

    result = asyncio.run(runs())
    spent = result.context_wrapper.usage
    return Held(inner.received, sp.Usage(prompt=spent.input_tokens, reply=spent.output_tokens), result.final_output)


def langchain_player(
    episode: sp.Episode, script: Script, *, play: Play, own_cap: int | None = None, situation: str = ""
) -> Held:
    model = ScriptedModel(script, own_cap)
    play(episode, LangChainPlayer(model))
    return Held(model.received)


def anthropic_player(
    episode: sp.Episode, script: Script, *, play: Play, own_cap: int | None = None, situation: str = ""
) -> Held:
    with AnthropicStub(script) as stub:
        own = {} if own_cap is None else {"max_tokens": own_cap}
        play(episode, AnthropicPlayer("m", base_url=stub.url, retries=0, parameters=own))
    return Held(stub.received)


def openai_player(
    episode: sp.Episode,
    script: Script,
    *,
    play: Play,
    own_cap: int | None = None,
    situation: str = "",
    kind: type[OpenAIPlayer] = OpenAIPlayer,
    cap_field: str = "max_tokens",
) -> Held:
    with OpenAIStub(script) as stub:
        own = {} if own_cap is None else {cap_field: own_cap}
        play(episode, kind("m", base_url=stub.base_url, retries=0, parameters=own))
    return Held(stub.received)


def window_endpoint(
    episode: sp.Episode, script: Script, *, interface: str, own_cap: int | None = None, situation: str = ""
) -> Held:
    """A host's agent plays at the endpoint; the model behind it is one of OpenAI's, which sees the window."""
    own = {} if own_cap is None else {"max_tokens": own_cap}
    with (
        OpenAIStub(script, EACH) as stub,
        OpenAIPlayer("m", base_url=stub.base_url, retries=0, parameters=own) as player,
        WindowEndpoint(player) as endpoint,
    ):
        handle = endpoint.serve(episode)
        agent = HostAgent(endpoint, handle)
        if interface == "mcp":
            agent.play()
            return Held(stub.received)
        tools: dict[str, Any] = {name: partial(agent.run_named, name) for name in ("observe", "act", "read_manual")}
        with client_of(interface, endpoint) as client:
            asks = INTERFACES[interface](client, endpoint.model(handle), True)
            play = partial(play_through, asks, tools)
            tools |= {"camera": lambda: asks.picture, "helper": lambda: play()[0]}
            own_tools = {"broken call": WEATHER, "picture": nothing("camera"), "sub-agent": nothing("helper")}
            offered = [*TOOLS, *[sp.schema(tool, "openai") for name, tool in own_tools.items() if name == situation]]
            aside = ""
            if situation == "no tools":
                aside = asks.ask([*asks.begin], []).text
            elif situation == "no calls":
                aside = asks.ask([*asks.begin], offered, tool_choice=asks.no_calls).text
            extra = asks.schema(SCHEMA) if situation == "schema" else {}
            words, usage = play(offered, forgets=situation == "forgets", **extra)
            words = play(offered)[0] if situation == "again" else words
    return Held(stub.received, usage, aside or words)


def nothing(name: str) -> sp.ToolSpec:
    """A tool without arguments."""
    return sp.ToolSpec(name, f"The {name}.", {"type": "object", "properties": {}})


Play = Callable[[sp.Episode, ModelPlayer], None]


def waiting(episode: sp.Episode, player: ModelPlayer) -> None:
    with player:
        sp.play(episode, player)


def on_a_loop(episode: sp.Episode, player: ModelPlayer) -> None:
    async def play() -> None:
        async with player:
            await sp.aplay(episode, player)

    asyncio.run(play())


responses_player = partial(openai_player, kind=ResponsesPlayer, cap_field="max_output_tokens")

AGENTS = "Agents SDK `SmartPlayModel`"
ANTHROPIC = "Anthropic player"
LANGCHAIN = "LangChain `SmartPlayMiddleware`"
OPENAI = "OpenAI players"
WINDOW_ENDPOINT = "Window endpoint"
PLAY = "`play`, `aplay`"

LOOP = lacking("a loop of ours or yours: there is no agent of a host's that could do anything beside playing")
AS_CHAT = lacking("it asks as the row of chat completions does, and differs in how it runs the calls")
ONE_NODE = lacking("the graph's node asks with the game's tools, in messages", "no calls", "no tools", "schema")
REFUSED = {"no calls": "tool choice `none`", "no tools": NO_GAME_TOOLS, "schema": "cannot have a"}

agents_row = partial(Window, through=AGENTS, refuses=REFUSED)
langchain_row = partial(Window, through=LANGCHAIN, refuses=REFUSED)
loop = partial(Window, lacks=LOOP)
endpoint_row = partial(Window, through=WINDOW_ENDPOINT)

WINDOW = {
    "AgentSession": loop(conformance.by_session, "`AgentSession`"),
    "Agents SDK": agents_row(agents_sdk),
    "Agents SDK, streamed": agents_row(partial(agents_sdk, streamed=True)),
    "Anthropic player": loop(partial(anthropic_player, play=waiting), ANTHROPIC, broken_json=False),
    "Anthropic player, async": loop(partial(anthropic_player, play=on_a_loop), ANTHROPIC, broken_json=False),
    "Conversation": loop(conformance.by_conversation, "`Conversation`"),
    "LangChain agent": langchain_row(langchain_agent),
    "LangChain agent, async": langchain_row(partial(langchain_agent, asynchronously=True)),
    "LangChain player": loop(partial(langchain_player, play=waiting), PLAY),
    "LangChain player, async": loop(partial(langchain_player, play=on_a_loop), PLAY),
    "LangGraph": Window(langgraph, LANGCHAIN, lacks=ONE_NODE),
    "Window endpoint, tools over MCP": endpoint_row(partial(window_endpoint, interface="mcp"), lacks=AS_CHAT),
    "Window endpoint, chat completions": endpoint_row(partial(window_endpoint, interface="chat")),
    "Window endpoint, Messages": endpoint_row(partial(window_endpoint, interface="messages")),
    "Window endpoint, Responses": endpoint_row(partial(window_endpoint, interface="responses")),
    "OpenAI player": loop(partial(openai_player, play=waiting), OPENAI),
    "OpenAI player, async": loop(partial(openai_player, play=on_a_loop), OPENAI),
    "OpenAI Responses player": loop(partial(responses_player, play=waiting), OPENAI),
    "OpenAI Responses player, async": loop(partial(responses_player, play=on_a_loop), OPENAI),
}


# Behind an endpoint there are two servers, so the conformance of the window endpoint is slow to test. What there is
# twice is played on an event loop by the slow tests, too.
def is_slow(row: str) -> bool:
    return WINDOW[row].through == WINDOW_ENDPOINT or row.endswith(", async")


def rows(names: Iterable[str]) -> list[Any]:
    return [pytest.param(row, marks=pytest.mark.slow) if is_slow(row) else row for row in names]


ROWS = rows(WINDOW)


@pytest.mark.parametrize("budget", ["tight", "lazy"])
def test_these_budgets_make_turns_leave_the_window(budget):
    episode, events = conformance.fresh(BUDGETS[budget])
    with episode:
        conformance.by_conversation(episode, BASIC)
    shown = [sum(last - first + 1 for first, last in e["turns"]) for e in events if e["event"] == "view"]
    assert max(turn - turns for turn, turns in enumerate(shown)) >= 4


@pytest.mark.parametrize("budget", BUDGETS)
@pytest.mark.parametrize("row", ROWS)
def test_the_game_cannot_tell_adapters_apart(row, budget):
    result = conformance.judge(WINDOW[row], BASIC, BUDGETS[budget])
    assert result.end_reason == ("prompt_tokens" if budget == "spent" else "terminated")
    assert result.refused_calls == (budget != "spent"), "the last act comes after the end"


@pytest.mark.parametrize("row", ROWS)
def test_the_tools_of_memory(row):
    conformance.judge_memory(WINDOW[row])


@pytest.mark.parametrize("row", ROWS)
def test_words_without_a_call(row):
    conformance.judge(WINDOW[row], IDLE, BUDGETS["tight"])


@pytest.mark.parametrize("row", rows(row for row in WINDOW if WINDOW[row].broken_json))
def test_arguments_that_are_no_json(row):
    conformance.judge(WINDOW[row], BROKEN, BUDGETS["tight"])


@pytest.mark.parametrize(
    ("row", "situation"),
    [
        pytest.param(row, situation, marks=pytest.mark.slow if is_slow(row) else ())
        for row in WINDOW
        for situation in situations.of(WINDOW[row])
    ],
)
def test_what_hosts_do(row, situation, caplog):
    situations.SITUATIONS[situation](WINDOW[row], caplog)


@pytest.mark.parametrize("row", ROWS)
def test_prompts_for_a_summary_are_answered_in_between(row):
    conformance.judge_summaries(WINDOW[row])


@pytest.mark.parametrize("row", ROWS)
def test_the_smaller_of_two_caps_on_replies_applies(row):
    conformance.judge_caps(WINDOW[row])


@pytest.mark.parametrize("row", ROWS)
def test_two_episodes_interleaved(row):
    """Each episode has its own thread; their replies alternate."""

    async def both() -> None:
        mine = Turns()
        others = mine.other_side()
        one = asyncio.to_thread(conformance.judge, WINDOW[row], BASIC, BUDGETS["tight"], mine)
        other = asyncio.to_thread(conformance.judge, WINDOW[row], IDLE, BUDGETS["free"], others)
        await asyncio.gather(one, other)
        assert min(mine.taken_in_turn, others.taken_in_turn) == len(BASIC)

    asyncio.run(both())


# --- Adapters whose host manages the context ---------------------------------------------------------------------

Opened = AsyncIterator[list[Send]]


@asynccontextmanager
async def direct(seeds: Sequence[int], folder: Path, send_to: Callable[[sp.Episode], Send]) -> Opened:
    """Episodes in this process."""
    with ExitStack() as stack:
        yield [send_to(stack.enter_context(host_episode(seed, folder))) for seed in seeds]


def through_episode(episode: sp.Episode) -> Send:
    async def send(name: str, arguments: Any) -> tuple[str, bool]:
        result = await episode.acall(name, arguments)
        return result.text, result.is_error

    return send


def through_functions(episode: sp.Episode) -> Send:
    functions = {function.__name__: function for function in episode.functions()}

    async def send(name: str, arguments: Any) -> tuple[str, None]:
        return functions[name](**arguments), None

    return send


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


class ThroughClient:
    def __init__(self, client: Client) -> None:
        self.client = client

    async def __call__(self, name: str, arguments: Any) -> tuple[str, bool]:
        result = await self.client.call_tool(name, arguments)
        return result.content[0].text, result.is_error


@asynccontextmanager
async def mcp_in_memory(seeds: Sequence[int], folder: Path, mode: str) -> Opened:
    async with AsyncExitStack() as stack:
        tables = [HostedEpisode(stack.enter_context(host_episode(seed, folder))) for seed in seeds]
        servers = [game_server(lambda _, table=table: table) for table in tables]
        yield [ThroughClient(await stack.enter_async_context(Client(server, mode=mode))) for server in servers]


@asynccontextmanager
async def mcp_on_stdio(seeds: Sequence[int], folder: Path, mode: str) -> Opened:
    """A process for each episode, as a host would start it."""
    async with AsyncExitStack() as stack:
        senders = []
        for seed in seeds:
            options = ["--seed", str(seed), "--history", str(HOST_BUDGET.history)]
            options += ["--transcript", str(folder / f"{seed}.jsonl")]
            command = ["-m", "smartplay_tools", "serve", "mcp", GAME, *options]
            server = StdioServerParameters(command=sys.executable, args=command, env=dict(os.environ))
            transport = stdio_client(server)
            senders.append(ThroughClient(await stack.enter_async_context(Client(transport, mode=mode))))
        yield senders


@asynccontextmanager
async def mcp_over_http(seeds: Sequence[int], folder: Path, mode: str) -> Opened:
    """One server for all episodes."""
    episodes = EpisodeStore(folder=folder)
    handles = [episodes.open(GAME, seed=seed, budget=HOST_BUDGET) for seed in seeds]
    async with AsyncExitStack() as stack:
        server = stack.enter_context(HttpServer(episodes, port=0))
        http = await stack.enter_async_context(httpx2.AsyncClient(trust_env=False, verify=False))
        addresses = [f"{server.url}/mcp/{handle}" for handle in handles]
        clients = [Client(streamable_http_client(address, http_client=http), mode=mode) for address in addresses]
        yield [ThroughClient(await stack.enter_async_context(client)) for client in clients]
    for handle in handles:
        episodes.close(handle)


def a_tool_that_there_is(name: str, arguments: Any) -> bool:
    return name in ("observe", "act", "read_manual")


def a_call_that_python_can_make(name: str, arguments: Any) -> bool:
    return a_tool_that_there_is(name, arguments) and list(arguments) == (["action"] if name == "act" else [])


ON_STDIO = "MCP on stdio"
"""A process for each game, which the slow tests start."""
FUNCTIONS = "`Episode.functions()`"
MCP = "MCP"
TOOLKIT = "LangChain `SmartPlayToolkit` alone"

HOST = {
    "Episode": Host(partial(direct, send_to=through_episode), "`Episode.call`"),
    "Functions": Host(partial(direct, send_to=through_functions), FUNCTIONS, a_call_that_python_can_make),
    "LangChain toolkit": Host(partial(direct, send_to=through_toolkit), TOOLKIT, a_tool_that_there_is),
    "LangChain toolkit, async": Host(
        partial(direct, send_to=partial(through_toolkit, asynchronously=True)), TOOLKIT, a_tool_that_there_is
    ),
    "LangChain toolkit in an agent": Host(
        partial(direct, send_to=through_toolkit_in_an_agent), TOOLKIT, a_tool_that_there_is
    ),
    "MCP in memory": Host(partial(mcp_in_memory, mode="auto"), MCP),
    "MCP in memory, legacy": Host(partial(mcp_in_memory, mode="legacy"), MCP),
    ON_STDIO: Host(partial(mcp_on_stdio, mode="auto"), MCP),
    f"{ON_STDIO}, legacy": Host(partial(mcp_on_stdio, mode="legacy"), MCP),
    "MCP over HTTP": Host(partial(mcp_over_http, mode="auto"), MCP),
    "MCP over HTTP, legacy": Host(partial(mcp_over_http, mode="legacy"), MCP),
}


def hosts(names: Iterable[str]) -> list[Any]:
    return [pytest.param(row, marks=pytest.mark.slow) if row.startswith(ON_STDIO) else row for row in names]


@pytest.mark.parametrize("row", hosts(HOST))
async def test_the_game_cannot_tell_hosts_apart(row, tmp_path):
    await conformance.judge_hosts(HOST[row], tmp_path)


# MCP alone has lists of what a client may read beside the tools; the window's lists nothing (`test_window_hosts.py`).
@pytest.mark.parametrize("row", hosts(row for row in HOST if HOST[row].through == MCP))
async def test_what_is_listed_can_be_read(row, tmp_path):
    async with HOST[row].open([7], tmp_path) as (send,):
        assert isinstance(send, ThroughClient)
        listed = (await send.client.list_resources()).resources
        assert [str(resource.uri) for resource in listed] == ["smartplay://manual"]
        for resource in listed:
            (content,) = (await send.client.read_resource(resource.uri)).contents
            assert "Tower of Hanoi" in content.text or "disk" in content.text


# --- What is enforced where: the table in the documentation -------------------------------------------------------


ELSEWHERE = {
    "Inspect AI `smartplay_agent`": "test_inspect.py",
    "OpenEnv `SmartPlayEnvironment`": "test_openenv.py",
    "OpenEnv `SmartPlayHarness`": "test_openenv.py",
    "Pydantic AI `SmartPlay`": "test_pydantic_ai.py",
    "TRL `environment`": "test_trl.py",
    "verifiers `SmartPlayHarness`": "test_verifiers.py",
}
"""The lines of frameworks that have environments of their own, and the files with their rows."""


def test_every_line_of_the_table_has_a_row():
    lines = table(OURS) | table(HOSTS)
    here = {line_of(row)["interface"] for row in (*WINDOW.values(), *HOST.values())}
    assert here | ELSEWHERE.keys() == lines.keys()
    for line, file in ELSEWHERE.items():
        assert line in Path(__file__).with_name(file).read_text(encoding="utf-8")


@pytest.mark.parametrize("row", ROWS)
def test_the_table_says_what_the_rows_show(row):
    conformance.check_line(WINDOW[row])


@pytest.mark.parametrize("row", HOST)
def test_the_table_says_what_the_rows_show_of_hosts(row):
    assert (line_of(HOST[row])["unknown tool"] == "answered") == HOST[row].carries("jump", {"how": "high"})


@pytest.mark.parametrize("broken", [{"name": "act", "arguments": "{"}, {"name": "act", "arguments": [1]}], ids=repr)
def test_mcp_refuses_arguments_that_are_no_object(broken):
    episodes = EpisodeStore()
    table = episodes.find(episodes.open(GAME, seed=1))
    call = {"jsonrpc": "2.0", "id": 1, "method": "tools/call", "params": broken}
    with HttpServer(episodes, port=0) as server:
        (handle,) = episodes._hosted
        headers = {"Accept": "application/json, text/event-stream"}
        answer = httpx2.post(
            f"{server.url}/mcp/{handle}", json=call, headers=headers, trust_env=False, verify=False
        ).json()
    assert "error" in answer
    assert table.episode.stats.tool_calls == 0


def test_what_never_reaches_a_plain_toolkit(tmp_path):
    """Why a toolkit alone is not a measurement: LangChain answers an unknown tool, and stops at broken JSON."""
    with host_episode(7, tmp_path) as episode:
        tools = SmartPlayToolkit(episode=episode).get_tools()
        unknown = ScriptedModel([calling(("jump", {})), calling(say="Well.")])
        state = create_agent(unknown, tools).invoke({"messages": []})
        assert "not a valid tool" in state["messages"][1].content
        broken = create_agent(ScriptedModel([calling(("act", "{"))]), tools).invoke({"messages": []})
        (reply,) = broken["messages"]
        assert isinstance(reply, AIMessage)
    assert episode.result.tool_calls == 0
