"""Servers in front of models, for the agents of other people.

`ContextEndpoint` holds any client of chat completions, Responses or Messages to the budget of a context manager, and
passes on everything else: docs/any-agent.md.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from smartplay_tools.errors import extra_named
from smartplay_tools.registry import lazy_exports

with extra_named("smartplay_gateway", "gateway"):
    import httpx2 as _httpx2  # noqa: F401
    import starlette as _starlette  # noqa: F401

if TYPE_CHECKING:
    from smartplay_gateway.passing import ContextEndpoint as ContextEndpoint

if not TYPE_CHECKING:
    __getattr__, __dir__, __all__ = lazy_exports(__name__)
