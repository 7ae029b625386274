"""An agent of LlamaIndex plays one episode; docs/clients.md says how it is started.

pip install llama-index-core==0.14.25 llama-index-llms-openai-like llama-index-tools-mcp
"""

import asyncio
import os

from llama_index.core.agent.workflow import FunctionAgent
from llama_index.llms.openai_like import OpenAILike
from llama_index.tools.mcp import BasicMCPClient, McpToolSpec

model = OpenAILike(model=os.environ["OPENAI_MODEL"], is_chat_model=True, is_function_calling_model=True)


async def play() -> None:
    tools = await McpToolSpec(client=BasicMCPClient(os.environ["SMARTPLAY_MCP_URL"])).to_tool_list_async()
    agent = FunctionAgent(tools=tools, llm=model)
    print(await agent.run("Play.", max_iterations=1000))


asyncio.run(play())
