"""An agent of OpenAI's Agents SDK plays; `SmartPlayModel` wraps the model that the runner calls.

    python examples/12_agents_sdk.py
    SMARTPLAY_MODEL=gpt-4o-mini python examples/12_agents_sdk.py

Without a model's name a local endpoint answers with the rule player, and no key is needed.
"""

import asyncio
import os
from contextlib import ExitStack

from agents import Agent, OpenAIChatCompletionsModel, Runner, set_tracing_disabled
from openai import AsyncOpenAI, DefaultAsyncHttpxClient
from smartplay_gateway import LocalEndpoint
from smartplay_openai.agents import SmartPlayModel

import smartplay_tools as sp

set_tracing_disabled(True)


async def play(episode: sp.Episode, name: str, client: AsyncOpenAI) -> None:
    async with client:
        model = SmartPlayModel(OpenAIChatCompletionsModel(name, client), episode)
        agent = Agent("player", model=model, tools=model.tools)
        await Runner.run(agent, [], max_turns=None, run_config=model.run_config)


with ExitStack() as stack:
    name = os.environ.get("SMARTPLAY_MODEL")
    if name:
        client = AsyncOpenAI()
    else:
        endpoint = stack.enter_context(LocalEndpoint(sp.get_player("rule")))
        here = DefaultAsyncHttpxClient(trust_env=False)  # no proxy on the way to this machine
        client = AsyncOpenAI(base_url=endpoint.base_url, api_key="none", http_client=here)
    episode = stack.enter_context(sp.Episode("Hanoi3Disk-v0", seed=7, budget=sp.Budget(prompt_tokens=700)))
    asyncio.run(play(episode, name or "rule", client))

print(f"{episode.result.score:g} disks moved in {episode.result.steps} steps ({episode.result.end_reason})")
