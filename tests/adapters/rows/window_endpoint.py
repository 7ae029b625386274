"""Agents at the window endpoint. Behind it there are two servers, so these rows are slow."""

from __future__ import annotations

from functools import partial
from typing import Any

from smartplay_gateway import WindowEndpoint
from smartplay_openai import OpenAIPlayer

import smartplay_tools as sp
from tests.adapters.conformance import EACH, WEATHER, Held, Replies, Window
from tests.adapters.openai_stub import OpenAIStub
from tests.adapters.situations import SCHEMA, lacking
from tests.adapters.window_host import INTERFACES, TOOLS, HostAgent, client_of, play_through


def window_endpoint(
    episode: sp.Episode,
    script: Replies,
    *,
    interface: str,
    own_cap: int | None = None,
    situation: str = "",
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
            own_tools = {
                "broken call": WEATHER,
                "withdrawn": WEATHER,
                "picture": nothing("camera"),
                "sub-agent": nothing("helper"),
            }
            offered = [*TOOLS, *[sp.schema(tool, "openai") for name, tool in own_tools.items() if name == situation]]
            if situation == "another episode":
                offered += [renamed(tool, "mcp__other__") for tool in TOOLS]
            aside = ""
            if situation == "no tools":
                aside = asks.ask([*asks.begin], []).text
            elif situation == "no calls":
                aside = asks.ask([*asks.begin], offered, tool_choice=asks.no_calls).text
            extra = asks.schema(SCHEMA) if situation == "schema" else {}
            later = TOOLS if situation == "withdrawn" else offered
            words, usage = play(offered, later, forgets=situation == "forgets", **extra)
            words = play(offered)[0] if situation == "again" else words
    return Held(stub.received, usage, aside or words)


def nothing(name: str) -> sp.ToolSpec:
    """A tool without arguments."""
    return sp.ToolSpec(name, f"The {name}.", {"type": "object", "properties": {}})


def renamed(tool: dict[str, Any], prefix: str) -> dict[str, Any]:
    """A tool as the client of an MCP server names it."""
    return {**tool, "function": {**tool["function"], "name": prefix + tool["function"]["name"]}}


AS_CHAT = lacking("it asks as the row of chat completions does, and differs in how it runs the calls")
BY_LOOK = lacking("the tools of an episode are the host's own, and known by their look", "another episode instead")
row = partial(Window, through="Window endpoint", slow=True, lacks=BY_LOOK)
WINDOW = {
    "Window endpoint, tools over MCP": row(partial(window_endpoint, interface="mcp"), lacks=AS_CHAT, repeats=True),
    "Window endpoint, chat completions": row(partial(window_endpoint, interface="chat")),
    "Window endpoint, Messages": row(partial(window_endpoint, interface="messages"), repeats=True),
    "Window endpoint, Responses": row(partial(window_endpoint, interface="responses"), repeats=True),
}
