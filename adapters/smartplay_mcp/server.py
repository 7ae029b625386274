"""The MCP server as an object of the official package `mcp`, for programs that host it in their own process.

The Claude Agent SDK takes such an object, as does every program that runs a `Server` on its own streams. It passes on
the answers of `smartplay_tools.web.mcp`: the schemas are unchanged, and only the episode validates arguments.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from smartplay_tools import InvalidArgumentError
from smartplay_tools.web import HostedEpisode
from smartplay_tools.web.mcp import (
    CALL_KEY,
    INSTRUCTIONS,
    MANUAL,
    SERVER_INFO,
    STATELESS_VERSIONS,
    ProtocolError,
    result_of,
    stateless_result,
)

if TYPE_CHECKING:
    from mcp.server.lowlevel import Server

__all__ = [
    "CALL_KEY",
    "MANUAL",
    "game_server",
]


Find = Callable[[Any], HostedEpisode]
"""Returns the episode of a request, from the package's request context; raises `MCPError` if there is none."""

PARAMETERS = {
    "tools/list": "PaginatedRequestParams",
    "tools/call": "CallToolRequestParams",
    "resources/list": "PaginatedRequestParams",
    "resources/templates/list": "PaginatedRequestParams",
    "resources/read": "ReadResourceRequestParams",
}
"""Methods, and the package's types for their parameters."""


def game_server(find: Find) -> Server[Any]:
    """Return an MCP server for the episodes that `find` knows; it needs the package `mcp`, version 2 or newer."""
    try:
        import mcp_types as types
        from mcp import MCPError
        from mcp.server.lowlevel import Server
    except ImportError as error:
        raise InvalidArgumentError(
            "game_server needs the package mcp, version 2 or newer: pip install 'mcp>=2'."
        ) from error

    def handler(method: str) -> Any:
        async def handle(context: Any, params: Any) -> Any:
            # Unchanged, because the types of the package would drop unknown fields.
            sent = {**(context.params or {}), "_meta": context.meta or {}}
            try:
                result = await result_of(find(context), method, sent)
            except ProtocolError as error:
                raise MCPError(code=error.code, message=str(error), data=error.data) from error
            is_stateless = context.protocol_version in STATELESS_VERSIONS
            return stateless_result(method, result) if is_stateless else result

        return handle

    server: Server[Any] = Server(
        SERVER_INFO["name"], version=SERVER_INFO["version"], title=SERVER_INFO["title"], instructions=INSTRUCTIONS
    )
    for method, parameters in PARAMETERS.items():
        server.add_request_handler(method, getattr(types, parameters), handler(method))
    return server
