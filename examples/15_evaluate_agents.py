"""A run whose players are agents: one of LangChain, with a tool of its own, and one of OpenAI's Agents SDK.

    python examples/15_evaluate_agents.py
    SMARTPLAY_MODEL=gpt-4o-mini python examples/15_evaluate_agents.py

Without a model's name a local endpoint answers with the rule player, and no key is needed.
"""

import os
from contextlib import ExitStack

from agents import Agent, OpenAIChatCompletionsModel, Runner, set_tracing_disabled
from langchain.agents import create_agent
from langchain_core.tools import tool
from langchain_openai import ChatOpenAI
from openai import AsyncOpenAI, DefaultAsyncHttpxClient, DefaultHttpxClient
from smartplay_gateway import LocalEndpoint
from smartplay_langchain import SmartPlayMiddleware
from smartplay_openai.agents import SmartPlayModel

import smartplay_tools as sp

set_tracing_disabled(True)


@tool
def add(a: int, b: int) -> int:
    """Add two numbers."""
    return a + b


def langchain(episode: sp.Episode) -> None:
    with DefaultHttpxClient(trust_env=not is_local) as http:
        model = ChatOpenAI(model=name, http_client=http, **where)
        create_agent(model, [add], middleware=[SmartPlayMiddleware(episode)]).invoke({"messages": []})


async def agents_sdk(episode: sp.Episode) -> None:
    async with AsyncOpenAI(http_client=DefaultAsyncHttpxClient(trust_env=not is_local), **where) as client:
        model = SmartPlayModel(OpenAIChatCompletionsModel(name, client), episode)
        agent = Agent("player", model=model, tools=model.tools)
        await Runner.run(agent, [], max_turns=None, run_config=model.run_config)


with ExitStack() as stack:
    name, where = os.environ.get("SMARTPLAY_MODEL", "rule"), {}
    is_local = name == "rule"
    if is_local:
        endpoint = stack.enter_context(LocalEndpoint(sp.get_player("rule")))
        where = {"base_url": endpoint.base_url, "api_key": "none"}
    agents = {"langchain": langchain, "agents-sdk": agents_sdk}
    budget = sp.Budget(prompt_tokens=900)
    run = sp.evaluate(["Hanoi3Disk-v0"], agents, out="runs/agents", trials=3, budgets=budget)

for row in run.rows:
    print(f"{row['player']:12} world {row['trial']}  score {row['score']:g}  {row['end_reason']}")
