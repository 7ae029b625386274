"""An agent of AG2 plays one episode; docs/clients.md says how it is started.

pip install 'ag2[mcp,openai]==1.2.1'
"""

import asyncio
import os

from ag2 import Agent
from ag2.config import OpenAIConfig
from ag2.tools import MCPToolkit

model = OpenAIConfig(model=os.environ["OPENAI_MODEL"])
agent = Agent("player", config=model, tools=[MCPToolkit(os.environ["SMARTPLAY_MCP_URL"])])
print(asyncio.run(agent.ask("Play.")).body)
