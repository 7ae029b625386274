"""An agent of AutoGen plays one episode; docs/clients.md says how it is started.

pip install autogen-agentchat==0.7.5 'autogen-ext[mcp,openai]==0.7.5' 'mcp<2'
"""

import asyncio
import os

from autogen_agentchat.agents import AssistantAgent
from autogen_ext.models.openai import OpenAIChatCompletionClient
from autogen_ext.tools.mcp import StreamableHttpServerParams, mcp_server_tools

info = {
    "family": "unknown",
    "function_calling": True,
    "json_output": False,
    "structured_output": False,
    "vision": False,
}
model = OpenAIChatCompletionClient(model=os.environ["OPENAI_MODEL"], model_info=info)


async def play() -> None:
    tools = await mcp_server_tools(StreamableHttpServerParams(url=os.environ["SMARTPLAY_MCP_URL"]))
    agent = AssistantAgent("player", model, tools=tools, max_tool_iterations=1000)
    print((await agent.run(task="Play.")).messages[-1])


asyncio.run(play())
