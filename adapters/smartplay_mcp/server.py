"""The MCP server as an object of the official package `mcp`, for programs that host it in their own process.

The Claude Agent SDK takes such an object, as does every program that runs a `Server` on its own streams. It passes on
the answers of `smartplay_tools.web.mcp`: the schemas are unchanged, and only the episode validates arguments.

The endpoint of the operator, `/episodes`: open an episode, read its result, close it.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import Route

from smartplay_tools import Budget, InvalidArgumentError, SmartPlayError
from smartplay_tools.web import EpisodeStore, FullError, HostedEpisode, hosted_or_refusal
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
    "prompts/list": "PaginatedRequestParams",
    "prompts/get": "GetPromptRequestParams",
    "completion/complete": "CompleteRequestParams",
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


def operator_routes(store: EpisodeStore) -> list[Route]:
    """Return the routes of the episodes in a store."""

    async def open_episode(request: Request) -> Response:
        try:
            handle = await asyncio.to_thread(_opened, store, await request.body())
        except FullError as error:
            return PlainTextResponse(str(error), 503)
        except SmartPlayError as error:
            return PlainTextResponse(str(error), 400)
        return JSONResponse({"episode": handle, "path": f"/mcp/{handle}"}, 201)

    async def show_episode(request: Request) -> Response:
        hosted = await hosted_or_refusal(store.find, request.path_params["handle"])
        if isinstance(hosted, Response):
            return hosted
        result = hosted.episode.result
        return JSONResponse({"done": hosted.episode.done, "result": result and result.model_dump()})

    async def close_episode(request: Request) -> Response:
        result = await hosted_or_refusal(store.close, request.path_params["handle"])
        return result if isinstance(result, Response) else JSONResponse({"done": True, "result": result.model_dump()})

    return [
        Route("/episodes", open_episode, methods=["POST"]),
        Route("/episodes/{handle}", show_episode, methods=["GET"]),
        Route("/episodes/{handle}", close_episode, methods=["DELETE"]),
    ]


def _opened(store: EpisodeStore, body: bytes) -> str:
    """Open the episode of an operator's request."""
    try:
        wanted = json.loads(body)
        game, seed, budget = str(wanted.pop("game")), wanted.pop("seed"), wanted.pop("budget", {})
        if reserved := wanted.keys() & {"transcript", "context", "self"}:
            raise InvalidArgumentError(f"These fields cannot be set: {', '.join(sorted(reserved))}.")
        return store.open(game, seed=seed, budget=Budget(**budget), **wanted)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise InvalidArgumentError(f"The budget cannot be read: {where}: {first['msg']}.") from error
    except SmartPlayError:
        raise
    except (ValueError, KeyError, AttributeError, TypeError, RecursionError) as error:
        raise InvalidArgumentError("Send a JSON object with game and seed.") from error
