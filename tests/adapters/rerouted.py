"""OpenAI's own address, taken to a server on this machine: what is sent to OpenAI alone is sent there."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from urllib.parse import urlsplit

import openai

_http = importlib.import_module(openai.DefaultHttpxClient.__mro__[1].__module__)
"""The HTTP library of the client, `httpx` or `httpx2`."""


@contextmanager
def clients(url: str) -> Iterator[dict[str, Any]]:
    """HTTP clients, synchronous and not, whose requests all go to the server at a URL, whatever their own says.

    Connections are not kept, so that nothing is left open when the event loop of an asynchronous client ends.
    """
    port = urlsplit(url).port
    options = {"trust_env": False, "limits": _http.Limits(max_keepalive_connections=0)}

    class Transport(_http.HTTPTransport):
        def handle_request(self, request: Any) -> Any:
            request.url = request.url.copy_with(scheme="http", host="127.0.0.1", port=port)
            return super().handle_request(request)

    class AsyncTransport(_http.AsyncHTTPTransport):
        async def handle_async_request(self, request: Any) -> Any:
            request.url = request.url.copy_with(scheme="http", host="127.0.0.1", port=port)
            return await super().handle_async_request(request)

    with _http.Client(transport=Transport(**options)) as client:
        yield {"http_client": client, "http_async_client": _http.AsyncClient(transport=AsyncTransport(**options))}
