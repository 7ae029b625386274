"""The guard before a server: what a request must have before the server looks at it.

A Host and, from a browser, an Origin that were allowed by name, because pages of other sites can reach servers on this
machine; and the token, if there is one. Then the body is read, if it is not too large.
"""

from __future__ import annotations

import hmac
import re
from collections.abc import Awaitable, Callable, Mapping, Sequence
from types import MappingProxyType

from starlette.middleware.cors import CORSMiddleware
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.types import ASGIApp, Receive, Scope, Send

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.players.environment import is_loopback
from smartplay_tools.web.bodies import LARGEST_CALL, Bounded

LOCAL = ("127.0.0.1", "localhost", "[::1]")
"""The names of this machine."""


def is_from_own_page(origin: str | None, site: str | None, host: str | None) -> bool:
    """Return whether a request that changes something comes from a page of the server itself, or from no page at all.

    `origin`, `site` and `host` are the headers Origin, Sec-Fetch-Site and Host. Another server on the same machine also
    has an expected origin, but its pages are not this server's.
    """
    if site not in (None, "same-origin", "none"):
        return False
    return origin is None or origin.partition("://")[2] == host


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
    guard = Guard(app, admit, hosts, origins, largest)
    return CORSMiddleware(
        guard,
        allow_origin_regex=guard.origin_pattern,
        allow_methods=["GET", "POST", "DELETE"],
        # Each client library for browsers sends other headers, and the page was allowed by its name.
        allow_headers=["*"],
        expose_headers=READ_IN_BROWSERS,
    )


def carries(request: Request, token: str, *, key_header: str | None = None) -> bool:
    """Whether a request carries a token: as a bearer token, or alone in the header with this name.

    The answer takes the same time for every wrong one.
    """
    alone = request.headers.get(key_header) if key_header else None
    sent = request.headers.get("authorization", "") if alone is None else f"Bearer {alone}"
    # A server decodes the bytes of a header as Latin-1.
    return hmac.compare_digest(sent.encode("latin-1"), f"Bearer {token}".encode())


def check_address(host: str, token: str | None, hosts: Sequence[str]) -> None:
    """Refuse an address that other machines reach without a token and the names by which they reach it."""
    if not is_loopback(host) and not (token and hosts):
        raise InvalidArgumentError(
            f"Other machines can reach {host}: give a token (--api-key) and the host names under which it is "
            "reached (--allow-host)."
        )


class Guard:
    """An application behind the guard.

    Arguments:
        app: the application.
        admit: the application's own conditions, asked when Host and Origin are right.
        hosts: the names under which the server is reached in addition to this machine's own, with or without a port.
        origins: the web pages that may use it from a browser, in addition to those of the hosts.
        largest: the most bytes of a body.
        headers: the headers of a refusal.
    """

    def __init__(
        self,
        app: ASGIApp,
        admit: Admit,
        hosts: Sequence[str] = (),
        origins: Sequence[str] = (),
        largest: int = LARGEST_CALL,
        headers: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        self._app, self._admit, self._headers = Bounded(app, largest), admit, headers
        host = "|".join(rf"{re.escape(name)}(:[0-9]+)?" for name in (*LOCAL, *hosts))
        named = "|".join(re.escape(origin.rstrip("/")) for origin in origins)
        self.origin_pattern = f"https?://({host})" + (f"|{named}" if named else "")
        """A regular expression for the whole of an Origin."""
        self._host, self._origin = re.compile(host), re.compile(self.origin_pattern)

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
        if not self._host.fullmatch(request.headers.get("host", "")):
            return PlainTextResponse("Invalid Host header", 421, self._headers)
        origin = request.headers.get("origin")  # only browsers send one
        if origin is not None and not self._origin.fullmatch(origin):
            return PlainTextResponse("Invalid Origin header", 403, self._headers)
        return await self._admit(request)
