"""An agent of Claude Agent SDK plays one episode; docs/clients.md says how it is started.

pip install claude-agent-sdk==0.2.187
smartplay-tools agent ... --only-game-tools
"""

import asyncio
import os

from claude_agent_sdk import ClaudeAgentOptions, ClaudeSDKClient

names = ("ANTHROPIC_BASE_URL", "ANTHROPIC_API_KEY", "ANTHROPIC_MODEL")
options = ClaudeAgentOptions(
    model=os.environ["ANTHROPIC_MODEL"],
    mcp_servers={"smartplay": {"type": "http", "url": os.environ["SMARTPLAY_MCP_URL"]}},
    allowed_tools=["mcp__smartplay"],
    strict_mcp_config=True,
    setting_sources=[],
    env={"CLAUDE_CODE_DISABLE_NONESSENTIAL_TRAFFIC": "1", **{name: os.environ[name] for name in names}},
)


async def play() -> None:
    async with ClaudeSDKClient(options) as client:
        await client.query("Play the game until it is over.")
        async for message in client.receive_response():
            print(message)


asyncio.run(play())
