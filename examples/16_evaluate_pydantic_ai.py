"""A run whose player is an agent of Pydantic AI, with a tool of its own.

    pip install 'smartplay-tools[pydantic-ai]'
    python examples/16_evaluate_pydantic_ai.py
    SMARTPLAY_MODEL=openai:gpt-4o-mini python examples/16_evaluate_pydantic_ai.py

Without a model's name the rule player answers in the model's place, and no key is needed.
"""

import os

from pydantic_ai import Agent
from pydantic_ai.usage import UsageLimits
from smartplay_pydantic_ai import PlayerModel, SmartPlay

import smartplay_tools as sp


def add(a: int, b: int) -> int:
    """Add two numbers."""
    return a + b


async def pydantic_ai(episode: sp.Episode) -> None:
    model = os.environ.get("SMARTPLAY_MODEL") or PlayerModel(sp.get_player("rule"))
    agent = Agent(model, tools=[add], capabilities=[SmartPlay(episode)])
    await agent.run("", usage_limits=UsageLimits(request_limit=None))


budget = sp.Budget(prompt_tokens=900)
run = sp.evaluate(["Hanoi3Disk-v0"], {"pydantic-ai": pydantic_ai}, out="runs/pydantic-ai", trials=3, budgets=budget)

for row in run.rows:
    print(f"{row['player']:12} world {row['trial']}  score {row['score']:g}  {row['end_reason']}")
