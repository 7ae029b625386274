"""An agent of Microsoft Agent Framework plays one episode; docs/clients.md says how it is started.

pip install agent-framework-core==1.23.0 agent-framework-openai mcp tenacity
"""

import asyncio
import os

from agent_framework import Agent, MCPStreamableHTTPTool
from agent_framework.openai import OpenAIChatCompletionClient

client = OpenAIChatCompletionClient(model=os.environ["OPENAI_MODEL"])
client.function_invocation_configuration["max_iterations"] = 1000


async def play() -> None:
    async with MCPStreamableHTTPTool(name="smartplay", url=os.environ["SMARTPLAY_MCP_URL"]) as tools:
        print(await Agent(client=client, tools=tools).run("Play."))


asyncio.run(play())
