"""An agent of Google ADK plays one episode; docs/clients.md says how it is started.

pip install google-adk==2.13.0 litellm mcp
"""

import asyncio
import os

from google.adk.agents import LlmAgent
from google.adk.agents.run_config import RunConfig
from google.adk.models.lite_llm import LiteLlm
from google.adk.runners import InMemoryRunner
from google.adk.tools.mcp_tool import McpToolset, StreamableHTTPConnectionParams
from google.genai import types

model = LiteLlm(model=f"openai/{os.environ['OPENAI_MODEL']}")


async def play() -> None:
    tools = McpToolset(connection_params=StreamableHTTPConnectionParams(url=os.environ["SMARTPLAY_MCP_URL"]))
    runner = InMemoryRunner(LlmAgent(name="player", model=model, tools=[tools]))
    session = await runner.session_service.create_session(app_name=runner.app_name, user_id="me")
    words = types.Content(role="user", parts=[types.Part(text="Play.")])
    limits = RunConfig(max_llm_calls=0)
    async for event in runner.run_async(user_id="me", session_id=session.id, new_message=words, run_config=limits):
        if event.is_final_response() and event.content:
            print(event.content.parts[0].text)
    await runner.close()


asyncio.run(play())
