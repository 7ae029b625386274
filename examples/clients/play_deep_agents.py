"""An agent of Deep Agents plays one episode; docs/clients.md says how it is started.

pip install deepagents==0.7.32 langchain-openai langchain-mcp-adapters
smartplay-tools agent ... --only-game-tools
"""

import asyncio
import os

from deepagents import create_deep_agent
from langchain_mcp_adapters.client import MultiServerMCPClient
from langchain_openai import ChatOpenAI

model = ChatOpenAI(model=os.environ["OPENAI_MODEL"], base_url=os.environ["OPENAI_BASE_URL"], api_key="none")
server = {"transport": "streamable_http", "url": os.environ["SMARTPLAY_MCP_URL"]}


async def play() -> None:
    tools = await MultiServerMCPClient({"smartplay": server}).get_tools()
    agent = create_deep_agent(model=model, tools=tools)
    state = await agent.ainvoke({"messages": [("user", "Play.")]}, {"recursion_limit": 10_000})
    print(state["messages"][-1].content)


asyncio.run(play())
