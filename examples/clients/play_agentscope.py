"""An agent of AgentScope plays one episode; docs/clients.md says how it is started.

pip install agentscope==2.0.10
"""

import asyncio
import os

from agentscope.agent import Agent, ReActConfig
from agentscope.credential import OpenAICredential
from agentscope.mcp import HttpMCPConfig, MCPClient
from agentscope.message import UserMsg
from agentscope.model import OpenAIChatModel
from agentscope.permission import PermissionContext, PermissionMode
from agentscope.state import AgentState
from agentscope.tool import Toolkit

credential = OpenAICredential(api_key="none", base_url=os.environ["OPENAI_BASE_URL"])
server = MCPClient(name="smartplay", is_stateful=False, mcp_config=HttpMCPConfig(url=os.environ["SMARTPLAY_MCP_URL"]))
agent = Agent(
    "player",
    "Play.",
    OpenAIChatModel(credential, os.environ["OPENAI_MODEL"]),
    Toolkit(mcps=[server]),
    state=AgentState(permission_context=PermissionContext(mode=PermissionMode.BYPASS)),
    react_config=ReActConfig(max_iters=1000),
)
print(asyncio.run(agent.reply(UserMsg("user", "Play."))).get_text_content())
