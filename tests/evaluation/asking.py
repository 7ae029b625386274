"""Requests without a client library, as a test sends them."""

from __future__ import annotations

from collections.abc import Mapping
from http.client import HTTPConnection
from typing import Any
from urllib.parse import urlsplit


def ask(url: str, body: Any = None, *, method: str = "GET", headers: Mapping[str, Any] = {}) -> tuple[int, Any, str]:
    """Return status, headers and text of an answer to a body, sent in chunks if it is of parts; redirections stay."""
    parts = urlsplit(url)
    connection = HTTPConnection(parts.hostname or "", parts.port, timeout=60)
    connection.request(method, parts.path + (f"?{parts.query}" if parts.query else ""), body, headers)
    answer = connection.getresponse()
    text = answer.read().decode()
    connection.close()
    return answer.status, answer.headers, text
