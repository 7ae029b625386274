"""An agent of OpenAI's Agents SDK plays one episode; docs/clients.md says how it is started.

pip install openai-agents==0.24.0
"""

import asyncio
import os

from agents import Agent, OpenAIResponsesModel, Runner, set_tracing_disabled
from agents.mcp import MCPServerStreamableHttp
from openai import AsyncOpenAI

set_tracing_disabled(True)
model = OpenAIResponsesModel(os.environ["OPENAI_MODEL"], AsyncOpenAI())


async def play() -> None:
    async with MCPServerStreamableHttp({"url": os.environ["SMARTPLAY_MCP_URL"]}) as server:
        agent = Agent("player", model=model, mcp_servers=[server])
        print((await Runner.run(agent, "Play.", max_turns=1000)).final_output)


asyncio.run(play())
