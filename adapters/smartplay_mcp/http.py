"""Streamable HTTP: many episodes behind one address, safe by default.

What a request must have before the protocol sees it: a Host and, from a browser, an Origin that were allowed by name;
the token, if there is one; a body of reasonable size; and the handle of an open episode. What is missing is refused in
a word. Two surfaces, two secrets: agents play under `/mcp`, their operator opens and closes episodes under `/episodes`,
which does not exist unless it has a token of its own.
"""

from __future__ import annotations

import hmac
import ipaddress
import json
import socket
import threading
import time
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Self, TypeVar

import anyio
import mcp_types as types
import uvicorn
from mcp import MCPError
from mcp.server.transport_security import TransportSecurityMiddleware, TransportSecuritySettings
from pydantic import ValidationError
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp, Receive, Scope, Send

from smartplay_mcp.episodes import Episodes, FullError
from smartplay_mcp.server import Table, game_server
from smartplay_tools import Budget, InvalidArgumentError, SmartPlayError

T = TypeVar("T")

LOCAL = ("127.0.0.1", "localhost", "[::1]")
LARGEST_BODY = 64 * 1024
"""Bytes; a call's arguments are malformed beyond 10,000 characters."""

BACKLOG = 2048
"""Connections that may wait to be accepted: a thousand agents begin at once."""

TABLE = "smartplay_table"
"""Where a request's scope holds its episode."""


def http_app(
    episodes: Episodes,
    *,
    token: str | None = None,
    operator_token: str | None = None,
    hosts: Sequence[str] = (),
) -> ASGIApp:
    """Return the server as an ASGI application.

    Arguments:
        episodes: who can be played with.
        token: the bearer token of agents; None lets in whoever reaches the server and knows a handle.
        operator_token: the bearer token of the operator; None switches `/episodes` off.
        hosts: the names under which the server is reached, beside this machine's own; with or without a port.
    """
    names = [*LOCAL, *hosts]
    security = TransportSecuritySettings(
        allowed_hosts=[form for name in names for form in (name, f"{name}:*")],
        allowed_origins=[
            f"{scheme}://{form}" for name in names for scheme in ("http", "https") for form in (name, f"{name}:*")
        ],
    )
    server = game_server(lambda context: _table(context.request))
    inner = server.streamable_http_app(
        json_response=True,
        stateless_http=True,
        max_request_body_size=LARGEST_BODY,
        transport_security=security,
        custom_starlette_routes=_operator_routes(episodes),
    )
    return _Door(inner, episodes, TransportSecurityMiddleware(security), token, operator_token)


class HttpServer:
    """The application on an address; `run` serves until it is stopped, `with` serves in a thread.

    An address that other machines reach needs a token and the names by which they reach it.
    """

    def __init__(
        self,
        episodes: Episodes,
        *,
        host: str = "127.0.0.1",
        port: int = 8000,
        token: str | None = None,
        operator_token: str | None = None,
        hosts: Sequence[str] = (),
    ) -> None:
        if not _is_loopback(host) and not (token and hosts):
            raise InvalidArgumentError(
                f"{host} may be reached by others: give a token, and the host names under which it is reached."
            )
        app = http_app(episodes, token=token, operator_token=operator_token, hosts=hosts)
        self._socket = _listening(host, port)
        self._server = uvicorn.Server(uvicorn.Config(app, log_level="warning", ws="none", backlog=BACKLOG))
        self._thread: threading.Thread | None = None
        shown = f"[{host}]" if ":" in host else host
        self.url = f"http://{shown}:{self._socket.getsockname()[1]}"

    def run(self) -> None:
        """Serve until the process is told to stop."""
        self._server.run([self._socket])

    def __enter__(self) -> Self:
        self._thread = threading.Thread(target=self._server.run, args=([self._socket],), daemon=True)
        self._thread.start()
        while not self._server.started and self._thread.is_alive():
            time.sleep(0.01)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        assert self._thread is not None
        self._server.should_exit = True
        self._thread.join()
        self._socket.close()


class _Door:
    """Everything that a request is asked before it comes in."""

    def __init__(
        self,
        app: ASGIApp,
        episodes: Episodes,
        security: TransportSecurityMiddleware,
        token: str | None,
        operator_token: str | None,
    ) -> None:
        self._app, self._episodes, self._security = app, episodes, security
        self._token, self._operator_token = token, operator_token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http":
            request = Request(scope)
            refusal = await self._security.validate_request(request) or await self._refusal(request)
            if refusal is not None:
                await refusal(scope, receive, send)
                return
        await self._app(scope, receive, send)

    async def _refusal(self, request: Request) -> Response | None:
        surface, _, handle = request.url.path.lstrip("/").partition("/")
        if surface == "episodes" and self._operator_token is not None:
            return None if _carries(request, self._operator_token) else _UNAUTHORIZED
        if surface != "mcp":
            return PlainTextResponse("Not found", 404)
        if self._token is not None and not _carries(request, self._token):
            return _UNAUTHORIZED
        handle = handle or request.query_params.get("episode") or request.headers.get("x-episode") or ""
        found = self._episodes.seated(handle) or await _asked(self._episodes.find, handle)
        if isinstance(found, Response):
            return found
        request.scope[TABLE] = found
        request.scope["path"] = "/mcp"
        return None


_UNAUTHORIZED = PlainTextResponse("Unauthorized", 401, headers={"WWW-Authenticate": "Bearer"})


def _carries(request: Request, token: str) -> bool:
    return hmac.compare_digest(request.headers.get("authorization", "").encode(), f"Bearer {token}".encode())


async def _asked(ask: Callable[[str], T | None], handle: str) -> T | Response:
    """Ask the episodes for one, in a thread, for it may have to be played again first; or say why there is none."""
    try:
        found = await anyio.to_thread.run_sync(ask, handle)
    except FullError as error:
        return PlainTextResponse(str(error), 503)
    except SmartPlayError:
        return PlainTextResponse("The record of this episode cannot be continued", 500)
    return PlainTextResponse("No such episode", 404) if found is None else found


def _table(request: Request | None) -> Table:
    table = None if request is None else request.scope.get(TABLE)
    if not isinstance(table, Table):
        raise MCPError(code=types.INVALID_PARAMS, message="No such episode")
    return table


def _listening(host: str, port: int) -> socket.socket:
    # asyncio sends small answers at once only on sockets whose protocol is named; else each may wait for 40 ms.
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listening = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((host, port))
    except OSError as error:
        listening.close()
        raise InvalidArgumentError(f"Nothing can listen on {host}:{port}: {error.strerror}.") from error
    listening.listen(BACKLOG)
    return listening


def _is_loopback(host: str) -> bool:
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def _operator_routes(episodes: Episodes) -> list[Route]:
    async def open_episode(request: Request) -> Response:
        body = b""
        async for chunk in request.stream():
            body += chunk
            if len(body) > LARGEST_BODY:
                return PlainTextResponse("Request body too large", 413)
        try:
            asked = json.loads(body)
            game, seed = str(asked.pop("game")), int(asked.pop("seed"))
            budget = Budget(**asked.pop("budget", {}))
            if reserved := asked.keys() & {"transcript", "context", "self"}:
                raise InvalidArgumentError(f"Not yours to choose: {', '.join(sorted(reserved))}.")
            handle = await anyio.to_thread.run_sync(lambda: episodes.open(game, seed=seed, budget=budget, **asked))
        except FullError as error:
            return PlainTextResponse(str(error), 503)
        except (ValueError, KeyError, AttributeError, TypeError, ValidationError) as error:
            known = isinstance(error, SmartPlayError)
            return PlainTextResponse(str(error) if known else "Send a JSON object with game and seed.", 400)
        return JSONResponse({"episode": handle, "path": f"/mcp/{handle}"}, 201)

    async def show_episode(request: Request) -> Response:
        found = await _asked(episodes.find, request.path_params["handle"])
        if isinstance(found, Response):
            return found
        result = found.episode.result
        return JSONResponse({"done": found.episode.done, "result": result and result.model_dump()})

    async def close_episode(request: Request) -> Response:
        found = await _asked(episodes.close, request.path_params["handle"])
        return found if isinstance(found, Response) else JSONResponse({"done": True, "result": found.model_dump()})

    return [
        Route("/episodes", open_episode, methods=["POST"]),
        Route("/episodes/{handle}", show_episode, methods=["GET"]),
        Route("/episodes/{handle}", close_episode, methods=["DELETE"]),
    ]
