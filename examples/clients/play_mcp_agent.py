"""An agent of mcp-agent plays one episode; docs/clients.md says how it is started.

pip install 'mcp-agent[openai]==0.2.6' 'mcp<2'
"""

import asyncio
import os

from mcp_agent.agents.agent import Agent
from mcp_agent.app import MCPApp
from mcp_agent.config import MCPServerSettings, MCPSettings, OpenAISettings, Settings
from mcp_agent.workflows.llm.augmented_llm import RequestParams
from mcp_agent.workflows.llm.augmented_llm_openai import OpenAIAugmentedLLM

server = MCPServerSettings(transport="streamable_http", url=os.environ["SMARTPLAY_MCP_URL"])
settings = Settings(
    mcp=MCPSettings(servers={"smartplay": server}),
    openai=OpenAISettings(api_key="none", base_url=os.environ["OPENAI_BASE_URL"]),
)


async def play() -> None:
    async with (
        MCPApp(name="player", settings=settings).run(),
        Agent(name="player", server_names=["smartplay"]) as agent,
    ):
        model = await agent.attach_llm(OpenAIAugmentedLLM)
        limits = RequestParams(model=os.environ["OPENAI_MODEL"], max_iterations=1000)
        print(await model.generate_str("Play.", limits))


asyncio.run(play())
