"""LangChain: the tools as a toolkit, the context window as a middleware, and players as models and models as players.

    from langchain.agents import create_agent
    from smartplay_langchain import SmartPlayMiddleware

    with sp.Episode("Hanoi3Disk-v0", seed=7, budget=sp.Budget(prompt_tokens=4096)) as episode:
        agent = create_agent(model, middleware=[SmartPlayMiddleware(episode)])
        agent.invoke({"messages": []})

`SmartPlayToolkit` needs only `langchain-core`; it gives the agent the tools and leaves the context to the host.
`SmartPlayMiddleware` needs `langchain` and owns the context: windows, budgets, order, ends and records are those of
`smartplay_tools.play`. `GraphSession`, on which the middleware is built, does the same for graphs built by hand.
`ContextManagerMiddleware` and `FittedModel` hold any other agent to a budget: docs/any-agent.md.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from smartplay_tools.errors import extra_named
from smartplay_tools.registry import lazy_exports

with extra_named("smartplay_langchain", "langchain"):
    import langchain_core as _langchain_core  # noqa: F401

if TYPE_CHECKING:
    from smartplay_langchain.chat_model import PlayerChatModel as PlayerChatModel
    from smartplay_langchain.fitting import (
        ContextManagerMiddleware as ContextManagerMiddleware,
        FittedModel as FittedModel,
    )
    from smartplay_langchain.graph import GraphSession as GraphSession
    from smartplay_langchain.messages import (
        from_langchain as from_langchain,
        to_langchain as to_langchain,
        usage_of as usage_of,
    )
    from smartplay_langchain.middleware import SmartPlayMiddleware as SmartPlayMiddleware
    from smartplay_langchain.models import LangChainPlayer as LangChainPlayer
    from smartplay_langchain.toolkit import SmartPlayTool as SmartPlayTool, SmartPlayToolkit as SmartPlayToolkit

if not TYPE_CHECKING:
    __getattr__, __dir__, __all__ = lazy_exports(__name__)
