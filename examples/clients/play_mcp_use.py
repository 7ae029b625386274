"""An agent of mcp-use plays one episode; docs/clients.md says how it is started.

pip install mcp-use==1.7.1 langchain-openai==1.7.3
"""

import asyncio
import os

from langchain_openai import ChatOpenAI
from mcp_use import MCPAgent, MCPClient

servers = {"mcpServers": {"smartplay": {"url": os.environ["SMARTPLAY_MCP_URL"]}}}
agent = MCPAgent(ChatOpenAI(model=os.environ["OPENAI_MODEL"]), MCPClient.from_dict(servers), max_steps=1000)
print(asyncio.run(agent.run("Play.")))
