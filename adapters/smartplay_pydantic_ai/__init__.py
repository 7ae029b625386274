"""Pydantic AI: a capability with which an agent plays an episode in the exact context window.

    with sp.Episode("Hanoi3Disk-v0", seed=7, budget=sp.Budget(prompt_tokens=4096)) as episode:
        agent = Agent("openai:gpt-4o-mini", capabilities=[SmartPlay(episode)])
        agent.run_sync("", usage_limits=UsageLimits(request_limit=None))

`SmartPlay` brings the tools and shows the model the window of one `AgentSession`; the agent's own history keeps
everything. `PlayerModel` makes a model of a player of this package, to try an agent without a key.
`ContextManagerCapability` holds an agent that plays nothing to a budget.
"""

from __future__ import annotations

from smartplay_tools.errors import extra_named

with extra_named("smartplay_pydantic_ai", "pydantic-ai"):
    import pydantic_ai as _pydantic_ai  # noqa: F401

from smartplay_pydantic_ai.capability import PlayerModel, SmartPlay
from smartplay_pydantic_ai.fitting import ContextManagerCapability
from smartplay_pydantic_ai.messages import from_response, read_usage

__all__ = ["ContextManagerCapability", "PlayerModel", "SmartPlay", "from_response", "read_usage"]
