"""LangChain: the tools as a toolkit, the context window as a middleware, and players as models and models as players.

    from langchain.agents import create_agent
    from smartplay_langchain import SmartPlayMiddleware

    with sp.Episode("Hanoi3Disk-v0", seed=7, budget=sp.Budget(prompt_tokens=4096)) as episode:
        agent = create_agent(model, middleware=[SmartPlayMiddleware(episode)])
        agent.invoke({"messages": []})

`SmartPlayToolkit` needs only `langchain-core`; it gives the agent the tools and leaves the context to the host.
`SmartPlayMiddleware` needs `langchain` and owns the context: windows, budgets, order, ends and records are those of
`smartplay_tools.play`. `GraphSession`, on which the middleware is built, does the same for graphs built by hand.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from smartplay_tools.errors import extra_named

with extra_named("smartplay_langchain", "langchain"):
    import langchain_core as _langchain_core  # noqa: F401

from smartplay_langchain.chat_model import PlayerChatModel
from smartplay_langchain.graph import GraphSession
from smartplay_langchain.messages import from_langchain, to_langchain, usage_of
from smartplay_langchain.models import LangChainPlayer
from smartplay_langchain.toolkit import SmartPlayTool, SmartPlayToolkit

if TYPE_CHECKING:
    from smartplay_langchain.middleware import SmartPlayMiddleware

__all__ = [
    "GraphSession",
    "LangChainPlayer",
    "PlayerChatModel",
    "SmartPlayMiddleware",
    "SmartPlayTool",
    "SmartPlayToolkit",
    "from_langchain",
    "to_langchain",
    "usage_of",
]


def __getattr__(name: str) -> Any:
    """Import the middleware on first use, because the rest of the package does not need `langchain`."""
    if name != "SmartPlayMiddleware":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    with extra_named("SmartPlayMiddleware", "langchain"):
        from smartplay_langchain.middleware import SmartPlayMiddleware
    return SmartPlayMiddleware
