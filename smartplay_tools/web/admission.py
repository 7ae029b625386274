"""Whether a request may come in: by its Host, its Origin and its token."""

from __future__ import annotations

import hmac
import ipaddress
import re
from collections.abc import Sequence

LOCAL = ("127.0.0.1", "localhost", "[::1]")
"""The names of this machine."""


class Names:
    """The names under which a server is reached, and the web pages that may use it.

    Arguments:
        hosts: names in addition to this machine's own, with or without a port.
        origins: web pages that may use the server from a browser, such as `https://inspector.example.org`, in addition
            to those of the hosts.
    """

    def __init__(self, hosts: Sequence[str] = (), origins: Sequence[str] = ()) -> None:
        host = "|".join(rf"{re.escape(name)}(:[0-9]+)?" for name in (*LOCAL, *hosts))
        named = "|".join(re.escape(origin.rstrip("/")) for origin in origins)
        self.origin_pattern = f"https?://({host})" + (f"|{named}" if named else "")
        """A regular expression for the whole of an Origin."""
        self._host, self._origin = re.compile(host), re.compile(self.origin_pattern)

    def knows_host(self, host: str | None) -> bool:
        """Return whether a Host header names this server."""
        return self._host.fullmatch(host or "") is not None

    def knows_origin(self, origin: str | None) -> bool:
        """Return whether an Origin header may use this server; only browsers send one."""
        return origin is None or self._origin.fullmatch(origin) is not None


def is_bearer(authorization: str | None, token: str) -> bool:
    """Return whether an Authorization header carries the token, in the same time for every wrong one."""
    sent = (authorization or "").encode("latin-1")  # as which a server decodes the bytes of a header
    return hmac.compare_digest(sent, f"Bearer {token}".encode())


def is_loopback(host: str) -> bool:
    """Return whether only this machine reaches an address."""
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def is_from_own_page(origin: str | None, site: str | None, host: str | None) -> bool:
    """Return whether a request that changes something comes from a page of the server itself, or from no page at all.

    `origin`, `site` and `host` are the headers Origin, Sec-Fetch-Site and Host. Another server on the same machine also
    has an expected origin, but its pages are not this server's.
    """
    if site not in (None, "same-origin", "none"):
        return False
    return origin is None or origin.partition("://")[2] == host
