"""An agent of smolagents plays one episode; docs/clients.md says how it is started.

pip install 'smolagents[openai,mcp]==1.26.0' 'mcp[ws]<2'
"""

import os

from smolagents import MCPClient, OpenAIServerModel, ToolCallingAgent

model = OpenAIServerModel(os.environ["OPENAI_MODEL"])
server = {"url": os.environ["SMARTPLAY_MCP_URL"], "transport": "streamable-http"}
with MCPClient(server, structured_output=False) as tools:
    agent = ToolCallingAgent(tools=tools, model=model, max_steps=200, verbosity_level=0)
    print(agent.run("Play."))
