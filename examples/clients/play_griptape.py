"""An agent of Griptape plays one episode; docs/clients.md says how it is started.

pip install 'griptape[drivers-prompt-openai]==1.13.0' 'mcp[ws]<2' exceptiongroup
"""

import os

from griptape.drivers.prompt.openai import OpenAiChatPromptDriver
from griptape.tasks import PromptTask
from griptape.tools import MCPTool

model = OpenAiChatPromptDriver(model=os.environ["OPENAI_MODEL"], base_url=os.environ["OPENAI_BASE_URL"])
server = {"transport": "streamable_http", "url": os.environ["SMARTPLAY_MCP_URL"]}
tools = [MCPTool(connection=server, name="smartplay")]
print(PromptTask("Play.", prompt_driver=model, tools=tools, max_subtasks=1000).run())
