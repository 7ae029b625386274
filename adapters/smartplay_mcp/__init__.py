"""MCP: a game as a server for any MCP host, on stdio (one process, one game) or streamable HTTP (many episodes).

    smartplay-tools serve mcp Hanoi3Disk-v0

The protocol has no session to which a game could belong: since 2026-07-28 every request is independent. On HTTP an
episode therefore belongs to a handle that cannot be guessed, which the program that serves creates and which is part of
the URL or of the header `X-Episode`. The host manages the context, so `observe` also returns the history, and token
budgets for prompts cannot be enforced.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from smartplay_tools.registry import lazy_exports

if TYPE_CHECKING:
    from smartplay_mcp.http import HttpServer as HttpServer, http_app as http_app
    from smartplay_mcp.stdio import open_episode as open_episode, serve_stdio as serve_stdio
    from smartplay_tools.web.mcp import CALL_KEY as CALL_KEY

if not TYPE_CHECKING:
    # On stdio no web framework is imported, and the first answer does not even wait for the game.
    __getattr__, __dir__, __all__ = lazy_exports(__name__)
