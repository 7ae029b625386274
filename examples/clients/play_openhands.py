"""An agent of OpenHands plays one episode; docs/clients.md says how it is started.

pip install openhands-sdk==1.58.0
smartplay-tools agent ... --only-game-tools
"""

import os

from openhands.sdk import LLM, Agent, Conversation
from pydantic import SecretStr

model = LLM(
    model=f"openai/{os.environ['OPENAI_MODEL']}",
    base_url=os.environ["OPENAI_BASE_URL"],
    api_key=SecretStr(os.environ["OPENAI_API_KEY"]),
)
servers = {"smartplay": {"url": os.environ["SMARTPLAY_MCP_URL"]}}
agent = Agent(llm=model, tools=[], mcp_config=servers)
conversation = Conversation(agent=agent, workspace=".", max_iteration_per_run=1000)
conversation.send_message("Play the game until it is over.")
conversation.run()
