"""The MCP server over streamable HTTP, with many episodes at one address.

A request is checked before the protocol handles it. It needs an allowed Host and, from a browser, an allowed Origin;
the token, if there is one; a body of limited size; and the handle of an open episode. Otherwise it is refused with a
short text.

Every request is answered with JSON. A game never sends messages by itself, so there are no event streams and no open
connections.
"""

from __future__ import annotations

from collections.abc import Sequence

from smartplay_tools.errors import extra_named

with extra_named("smartplay_mcp.http", "mcp"):
    import uvicorn as _uvicorn  # noqa: F401
    from starlette.applications import Starlette
    from starlette.requests import Request
    from starlette.responses import PlainTextResponse, Response
    from starlette.types import ASGIApp

from smartplay_tools.web import (
    UNAUTHORIZED,
    EpisodeStore,
    Server,
    carries,
    check_address,
    guarded,
)
from smartplay_tools.web.mcp_http import bind_episode, mcp_route


def http_app(
    store: EpisodeStore,
    *,
    token: str | None = None,
    hosts: Sequence[str] = (),
    origins: Sequence[str] = (),
) -> ASGIApp:
    """Return the server as an ASGI application.

    Arguments:
        store: the episodes that can be played.
        token: the bearer token of agents; None admits everybody who can reach the server and knows a handle.
        hosts: the names under which the server is reached, in addition to this machine's; with or without a port.
        origins: the web pages that may use it from a browser, such as `https://inspector.example.org`, apart from those
            of the hosts themselves.
    """

    async def admit(request: Request) -> Response | None:
        if request.url.path.lstrip("/").partition("/")[0] != "mcp":
            return PlainTextResponse("Not found", 404)
        if token is not None and not carries(request, token):
            return UNAUTHORIZED
        return await bind_episode(request, store)

    return guarded(Starlette(routes=[mcp_route()]), admit, hosts=hosts, origins=origins)


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
        hosts: Sequence[str] = (),
        origins: Sequence[str] = (),
    ) -> None:
        check_address(host, token, hosts)
        app = http_app(store, token=token, hosts=hosts, origins=origins)
        super().__init__(app, host, port)
