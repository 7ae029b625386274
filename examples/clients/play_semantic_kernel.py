"""An agent of Semantic Kernel plays one episode; docs/clients.md says how it is started.

pip install 'semantic-kernel[mcp]==1.45.0'
"""

import asyncio
import os

from semantic_kernel.agents import ChatCompletionAgent
from semantic_kernel.connectors.ai import FunctionChoiceBehavior
from semantic_kernel.connectors.ai.open_ai import OpenAIChatCompletion
from semantic_kernel.connectors.mcp import MCPStreamableHttpPlugin

model = OpenAIChatCompletion(ai_model_id=os.environ["OPENAI_MODEL"])
behavior = FunctionChoiceBehavior.Auto(maximum_auto_invoke_attempts=1000)


async def play() -> None:
    async with MCPStreamableHttpPlugin("smartplay", os.environ["SMARTPLAY_MCP_URL"], load_prompts=False) as tools:
        agent = ChatCompletionAgent(service=model, plugins=[tools], function_choice_behavior=behavior)
        print(await agent.get_response("Play."))


asyncio.run(play())
