"""An agent of BeeAI plays one episode; docs/clients.md says how it is started.

pip install 'beeai-framework[mcp]==0.1.85' 'litellm<1.100'
smartplay-tools agent ... --only-game-tools
"""

import asyncio
import os

from beeai_framework.adapters.openai import OpenAIChatModel
from beeai_framework.agents.requirement import RequirementAgent
from beeai_framework.tools.mcp import MCPTool
from mcp.client.streamable_http import streamablehttp_client

model = OpenAIChatModel(
    os.environ["OPENAI_MODEL"],
    base_url=os.environ["OPENAI_BASE_URL"],
    api_key="none",
    tool_choice_support={"auto", "none", "required", "single"},
)


async def play() -> None:
    tools = await MCPTool.from_client(streamablehttp_client(os.environ["SMARTPLAY_MCP_URL"]))
    agent = RequirementAgent(llm=model, tools=tools)
    print((await agent.run("Play the game until it is over.", max_iterations=1000)).last_message.text)


asyncio.run(play())
