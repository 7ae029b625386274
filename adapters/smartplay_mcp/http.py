"""The MCP server over streamable HTTP, with many episodes at one address.

A request is checked before the protocol handles it. It needs an allowed Host and, from a browser, an allowed Origin;
the token, if there is one; a body of limited size; and the handle of an open episode. Otherwise it is refused with a
short text. Agents play under `/mcp`. Their operator opens and closes episodes under `/episodes`, which has a separate
token and does not exist without one.

Every request is answered with JSON. A game never sends messages by itself, so there are no event streams and no open
connections.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Sequence

from smartplay_tools.errors import extra_named

with extra_named("smartplay_mcp.http", "mcp"):
    import uvicorn as _uvicorn  # noqa: F401
    from starlette.applications import Starlette
    from starlette.requests import Request
    from starlette.responses import JSONResponse, PlainTextResponse, Response
    from starlette.routing import Route
    from starlette.types import ASGIApp

from smartplay_tools import Budget, InvalidArgumentError, SmartPlayError
from smartplay_tools.web import (
    UNAUTHORIZED,
    EpisodeStore,
    FullError,
    Server,
    carries,
    check_address,
    guarded,
    hosted_or_refusal,
)
from smartplay_tools.web.mcp_http import bind_episode, mcp_route


def http_app(
    store: EpisodeStore,
    *,
    token: str | None = None,
    operator_token: str | None = None,
    hosts: Sequence[str] = (),
    origins: Sequence[str] = (),
) -> ASGIApp:
    """Return the server as an ASGI application.

    Arguments:
        store: the episodes that can be played.
        token: the bearer token of agents; None admits everybody who can reach the server and knows a handle.
        operator_token: the bearer token of the operator; None switches `/episodes` off.
        hosts: the names under which the server is reached, in addition to this machine's; with or without a port.
        origins: the web pages that may use it from a browser, such as `https://inspector.example.org`, apart from those
            of the hosts themselves.
    """

    async def admit(request: Request) -> Response | None:
        surface = request.url.path.lstrip("/").partition("/")[0]
        if surface == "episodes" and operator_token is not None:
            return None if carries(request, operator_token) else UNAUTHORIZED
        if surface != "mcp":
            return PlainTextResponse("Not found", 404)
        if token is not None and not carries(request, token):
            return UNAUTHORIZED
        return await bind_episode(request, store)

    routes = [mcp_route(), *operator_routes(store)]
    return guarded(Starlette(routes=routes), admit, hosts=hosts, origins=origins)


class HttpServer(Server):
    """The application on an address; `run` serves until it is stopped, `with` serves in a thread.

    An address that other machines reach needs a token and the names by which they reach it.
    """

    def __init__(
        self,
        store: EpisodeStore,
        *,
        host: str = "127.0.0.1",
        port: int = 8000,
        token: str | None = None,
        operator_token: str | None = None,
        hosts: Sequence[str] = (),
        origins: Sequence[str] = (),
    ) -> None:
        check_address(host, token, hosts)
        app = http_app(store, token=token, operator_token=operator_token, hosts=hosts, origins=origins)
        super().__init__(app, host, port)


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
    except SmartPlayError:
        raise
    except (ValueError, KeyError, AttributeError, TypeError, RecursionError) as error:
        raise InvalidArgumentError("Send a JSON object with game and seed.") from error
