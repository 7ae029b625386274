"""MCP: a game as a server for any MCP host, on stdio (one process, one game) or streamable HTTP (many episodes).

    smartplay-tools serve mcp Hanoi3Disk-v0

The protocol has no session to hang a game on: since 2026-07-28 each request stands alone. So on HTTP an episode is
bound to a handle, which its operator makes and nobody can guess, in the URL or in the header `X-Episode`. The host owns
the context; `observe` therefore shows the history, and token budgets for prompts cannot be enforced.
"""

from __future__ import annotations

from smartplay_tools import MissingExtraError

try:
    import mcp as _mcp  # noqa: F401
    import uvicorn as _uvicorn  # noqa: F401
except ModuleNotFoundError as error:
    raise MissingExtraError("smartplay_mcp", "mcp") from error

from smartplay_mcp.episodes import Episodes, FullError
from smartplay_mcp.http import HttpServer, http_app
from smartplay_mcp.server import Table, game_server, serve_stdio

__all__ = ["Episodes", "FullError", "HttpServer", "Table", "game_server", "http_app", "serve_stdio"]
