"""An agent of Haystack plays one episode; docs/clients.md says how it is started.

pip install haystack-ai==3.4.0 mcp-haystack==2.1.1
"""

import os

from haystack.components.agents import Agent
from haystack.components.generators.chat import OpenAIChatGenerator
from haystack.dataclasses import ChatMessage
from haystack_integrations.tools.mcp import MCPToolset, StreamableHttpServerInfo

model = OpenAIChatGenerator(model=os.environ["OPENAI_MODEL"])
tools = MCPToolset(StreamableHttpServerInfo(url=os.environ["SMARTPLAY_MCP_URL"]), eager_connect=True)
agent = Agent(chat_generator=model, tools=tools, max_agent_steps=1000, tool_concurrency_limit=1)
print(agent.run(messages=[ChatMessage.from_user("Play.")])["last_message"].text)
