"""An agent of Agno plays one episode; docs/clients.md says how it is started.

pip install agno==3.1.10 openai 'fastmcp>=4,<5'
"""

import asyncio
import os

from agno.agent import Agent
from agno.models.openai import OpenAIChat
from agno.tools.mcp import MCPTools


async def play() -> None:
    async with MCPTools(transport="streamable-http", url=os.environ["SMARTPLAY_MCP_URL"]) as tools:
        agent = Agent(model=OpenAIChat(id=os.environ["OPENAI_MODEL"]), tools=[tools], telemetry=False)
        print((await agent.arun("Play.")).content)


asyncio.run(play())
