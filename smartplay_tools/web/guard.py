"""The guard before a server: what a request must have before the server looks at it.

A Host and, from a browser, an Origin that were allowed by name, because pages of other sites can reach servers on this
machine; and the token, if there is one. Then the body is read, if it is not too large.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping, Sequence
from types import MappingProxyType

from starlette.middleware.cors import CORSMiddleware
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.types import ASGIApp, Receive, Scope, Send

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.web.admission import Names, is_bearer, is_loopback
from smartplay_tools.web.bodies import LARGEST_CALL, Bounded

READ_IN_BROWSERS = ("mcp-protocol-version", "retry-after", "www-authenticate", "x-should-retry", "x-smartplay-ignored")
"""Headers of answers that clients in a browser may read."""

Admit = Callable[[Request], Awaitable[Response | None]]
"""An application's own conditions: returns the response that refuses a request, or None. It may change the scope."""


def guarded(
    app: ASGIApp,
    admit: Admit,
    *,
    hosts: Sequence[str] = (),
    origins: Sequence[str] = (),
    largest: int = LARGEST_CALL,
) -> ASGIApp:
    """Return an application for programs, behind the guard.

    Arguments:
        app: the application.
        admit: the application's own conditions, asked when Host and Origin are right.
        hosts: the names under which the server is reached in addition to this machine's own, with or without a port.
        origins: the web pages that may use it from a browser, such as `https://inspector.example.org`, in addition to
            those of the hosts.
        largest: the most bytes of a body.
    """
    names = Names(hosts, origins)
    return CORSMiddleware(
        Guard(app, admit, names, largest),
        allow_origin_regex=names.origin_pattern,
        allow_methods=["GET", "POST", "DELETE"],
        # Every client for browsers sends headers of its own, and the page was allowed by its name.
        allow_headers=["*"],
        expose_headers=READ_IN_BROWSERS,
    )


def carries(request: Request, token: str, *, key_header: str | None = None) -> bool:
    """Whether a request carries a token: as a bearer token, or alone in the header with this name."""
    sent = request.headers.get(key_header) if key_header else None
    return is_bearer(request.headers.get("authorization") if sent is None else f"Bearer {sent}", token)


def check_address(host: str, token: str | None, hosts: Sequence[str]) -> None:
    """Refuse an address that other machines reach without a token and the names by which they reach it."""
    if not is_loopback(host) and not (token and hosts):
        raise InvalidArgumentError(
            f"Other machines can reach {host}: give a token, and the host names under which it is reached."
        )


class Guard:
    """An application behind the guard.

    Arguments:
        app: the application.
        admit: the application's own conditions, asked when Host and Origin are right.
        names: the expected hosts and origins.
        largest: the most bytes of a body.
        headers: the headers of a refusal.
    """

    def __init__(
        self,
        app: ASGIApp,
        admit: Admit,
        names: Names,
        largest: int = LARGEST_CALL,
        headers: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        self._app, self._admit, self._names, self._headers = Bounded(app, largest), admit, names, headers

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request."""
        if scope["type"] == "http":
            scope["path"] = scope["path"].rstrip("/") or "/"
            refusal = await self._refusal(Request(scope))
            if refusal is not None:
                await refusal(scope, receive, send)
                return
        await self._app(scope, receive, send)

    async def _refusal(self, request: Request) -> Response | None:
        if not self._names.knows_host(request.headers.get("host")):
            return PlainTextResponse("Invalid Host header", 421, self._headers)
        if not self._names.knows_origin(request.headers.get("origin")):
            return PlainTextResponse("Invalid Origin header", 403, self._headers)
        return await self._admit(request)
