"""An agent of CAMEL plays one episode; docs/clients.md says how it is started.

pip install camel-ai==0.2.90 'mcp<2'
"""

import asyncio
import os

from camel.agents import ChatAgent
from camel.models import OpenAICompatibleModel
from camel.toolkits import MCPToolkit
from camel.utils import BaseTokenCounter


class NoCounter(BaseTokenCounter):
    def count_tokens_from_messages(self, messages: list) -> int:
        return 0

    def encode(self, text: str) -> list[int]:
        return []

    def decode(self, token_ids: list[int]) -> str:
        return ""


model = OpenAICompatibleModel(
    os.environ["OPENAI_MODEL"],
    api_key="none",
    url=os.environ["OPENAI_BASE_URL"],
    token_counter=NoCounter(),
)
servers = {"mcpServers": {"smartplay": {"url": os.environ["SMARTPLAY_MCP_URL"]}}}


async def play() -> None:
    async with MCPToolkit(config_dict=servers) as toolkit:
        agent = ChatAgent(model=model, tools=toolkit.get_tools())
        print((await agent.astep("Play.")).msg.content)


asyncio.run(play())
