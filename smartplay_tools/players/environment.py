"""Keys, proxies and local addresses, checked first: client libraries report a wrong one late, or print the key."""

from __future__ import annotations

import os
import re
import unicodedata
from collections.abc import Iterator
from contextlib import contextmanager
from ipaddress import ip_address
from urllib.parse import urlsplit

from smartplay_tools.errors import InvalidArgumentError

_SENDABLE = re.compile(r"[ \t]*[!-~]+(?:[ \t]+[!-~]+)*")
"""What the value of a header can hold (RFC 9110, section 5.5), without the obsolete bytes beyond ASCII."""

_PROXIES = ("http_proxy", "https_proxy", "all_proxy", "no_proxy")
"""The environment variables that HTTP clients read, in small and in capital letters."""


def check_key(key: str | None, player: str) -> None:
    """Raise an `InvalidArgumentError` that does not print the key if no header of a request can hold it."""
    if key is None or _SENDABLE.fullmatch(key):
        return
    wrong = next((character for character in key if not (" " <= character <= "~" or character == "\t")), key[-1:])
    if wrong in ("\n", "\r"):
        what = "a line break"
    elif wrong in ("", " ", "\t"):
        what = "a blank at its end"
    else:
        what = f"the character U+{ord(wrong):04X} ({unicodedata.name(wrong, 'a control character')})"
    raise InvalidArgumentError(
        f"The key of {player} cannot be sent: it has {what}, which no header of a request can hold. Copy the key again."
    )


def check_url(url: str, given: str) -> None:
    """Raise an `InvalidArgumentError` if a server cannot be at an address; `given` says where that comes from."""
    try:
        parts = urlsplit(url)
        is_address = parts.scheme in ("http", "https") and bool(parts.hostname) and parts.port != 0
    except ValueError:  # brackets or a port that are none
        is_address = False
    if not is_address:
        scheme = "http" if is_loopback(url.partition("/")[0].partition(":")[0]) else "https"
        example = f"{scheme}://{url}" if re.fullmatch(r"[\w.-]+(?::\d+)?(?:/.*)?", url) else "http://localhost:11434/v1"
        raise InvalidArgumentError(
            f"{given} {url!r} is not the address of a server: begin with http:// or https://, as in {example}."
        )


def is_loopback(host: str) -> bool:
    """Return whether only this machine reaches an address."""
    try:
        return host == "localhost" or ip_address(host).is_loopback
    except ValueError:
        return False


@contextmanager
def readable_proxies() -> Iterator[None]:
    """Raise an `InvalidArgumentError` that names the variables if a client cannot read the environment's proxies.

    The values are not printed, because the address of a proxy may hold a password.
    """
    try:
        yield
    except Exception as error:
        names = sorted(name for name, value in os.environ.items() if name.lower() in _PROXIES and value)
        is_unread = type(error).__name__ == "InvalidURL" or (
            isinstance(error, ValueError | ImportError) and "proxy" in str(error).lower()
        )
        if not names or not is_unread:
            raise
        reason = f" ({error})" if isinstance(error, ImportError) else ""
        raise InvalidArgumentError(
            f"The client of this model cannot read the proxies of the environment, {', '.join(names)}{reason}: correct "
            "them or take them out. A network such as ::1/128 and an address in brackets have no place in NO_PROXY."
        ) from None
