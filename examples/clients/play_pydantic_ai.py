"""An agent of Pydantic AI plays one episode; docs/clients.md says how it is started.

pip install 'pydantic-ai-slim[openai,mcp]==2.68.0'
"""

import os

from pydantic_ai import Agent, UsageLimits
from pydantic_ai.mcp import MCPToolset
from pydantic_ai.models.openai import OpenAIChatModel

model = OpenAIChatModel(os.environ["OPENAI_MODEL"])
agent = Agent(model, toolsets=[MCPToolset(os.environ["SMARTPLAY_MCP_URL"])])
print(agent.run_sync("Play.", usage_limits=UsageLimits(request_limit=None)).output)
