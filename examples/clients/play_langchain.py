"""An agent of LangChain plays one episode; docs/clients.md says how it is started.

pip install langchain==1.4.7 langchain-openai==1.7.3 langchain-mcp-adapters==0.3.2
"""

import asyncio
import os

from langchain.agents import create_agent
from langchain_mcp_adapters.client import MultiServerMCPClient
from langchain_openai import ChatOpenAI

server = {"transport": "streamable_http", "url": os.environ["SMARTPLAY_MCP_URL"]}


async def play() -> None:
    tools = await MultiServerMCPClient({"smartplay": server}).get_tools()
    agent = create_agent(ChatOpenAI(model=os.environ["OPENAI_MODEL"]), tools)
    state = await agent.ainvoke({"messages": [("user", "Play.")]}, {"recursion_limit": 10_000})
    print(state["messages"][-1].content)


asyncio.run(play())
