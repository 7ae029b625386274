"""An agent of Mirascope plays one episode; docs/clients.md says how it is started.

pip install 'mirascope[mcp,openai]==2.8.2'
"""

import asyncio
import os

from mirascope import llm
from mirascope.llm.mcp import streamable_http_client

llm.register_provider("openai:completions", scope="smartplay/", base_url=os.environ["OPENAI_BASE_URL"])


async def play() -> None:
    async with streamable_http_client(os.environ["SMARTPLAY_MCP_URL"]) as server:
        model = llm.model(os.environ["OPENAI_MODEL"])
        response = await model.call_async("Play.", tools=await server.list_tools())
        while response.tool_calls:
            response = await response.resume(await response.execute_tools())
        print(response.text())


asyncio.run(play())
