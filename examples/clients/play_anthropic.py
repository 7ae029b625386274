"""An agent of Anthropic's SDK plays one episode; docs/clients.md says how it is started.

pip install anthropic==2.12.0 'mcp==2.3.0'
"""

import asyncio
import os

from anthropic import AsyncAnthropic
from anthropic.lib.tools.mcp import async_mcp_tool
from mcp import Client


async def play() -> None:
    async with Client(os.environ["SMARTPLAY_MCP_URL"]) as server:
        tools = [async_mcp_tool(tool, server) for tool in (await server.list_tools()).tools]
        runner = AsyncAnthropic().beta.messages.tool_runner(
            model=os.environ["ANTHROPIC_MODEL"],
            max_tokens=1000,
            messages=[{"role": "user", "content": "Play."}],
            tools=tools,
        )
        print((await runner.until_done()).content)


asyncio.run(play())
