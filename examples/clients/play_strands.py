"""An agent of Strands Agents plays one episode; docs/clients.md says how it is started.

pip install 'strands-agents[openai]==1.62.0'
"""

import os

from mcp.client.streamable_http import streamable_http_client
from strands import Agent
from strands.models.openai import OpenAIModel
from strands.tools.mcp import MCPClient

model = OpenAIModel(model_id=os.environ["OPENAI_MODEL"])
with MCPClient(lambda: streamable_http_client(os.environ["SMARTPLAY_MCP_URL"])) as server:
    agent = Agent(model=model, tools=server.list_tools_sync(), callback_handler=None)
    print(agent("Play."))
