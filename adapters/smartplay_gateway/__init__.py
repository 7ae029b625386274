"""Servers in front of models, for the agents and programs of other people.

`ContextEndpoint` holds any client of chat completions, Responses or Messages to the budget of a context manager, and
passes on everything else: docs/any-agent.md. It needs the extra `gateway`.

`WindowEndpoint` is a game's own context window behind the same interfaces, for agents in any language, and
`LocalEndpoint` serves any player as OpenAI's interfaces do, so that a loop can be tried, tested and shown without a
key. They need the extra `serve`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from smartplay_tools.registry import lazy_exports

if TYPE_CHECKING:
    from smartplay_gateway.endpoint import LocalEndpoint as LocalEndpoint, endpoint_app as endpoint_app
    from smartplay_gateway.passing import ContextEndpoint as ContextEndpoint
    from smartplay_gateway.window.app import WindowEndpoint as WindowEndpoint, window_app as window_app
    from smartplay_gateway.window.store import WindowStore as WindowStore

if not TYPE_CHECKING:
    __getattr__, __dir__, __all__ = lazy_exports(__name__)
