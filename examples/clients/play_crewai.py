"""An agent of CrewAI plays one episode; docs/clients.md says how it is started.

pip install crewai==1.15.30 'crewai-tools[mcp]'
"""

import os

from crewai import LLM, Agent, Crew, Task
from crewai_tools import MCPServerAdapter

model = LLM(model=os.environ["OPENAI_MODEL"], provider="openai")
server = {"url": os.environ["SMARTPLAY_MCP_URL"], "transport": "streamable-http"}
with MCPServerAdapter(server) as tools:
    player = Agent(role="player", goal="win", backstory="none", llm=model, tools=list(tools), max_iter=1000)
    task = Task(description="Play.", expected_output="the end", agent=player)
    print(Crew(agents=[player], tasks=[task]).kickoff())
