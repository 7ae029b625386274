"""Common functions of the HTTP server: reading bodies of limited size, refusals, and finding an episode."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import TypeVar

from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response

from smartplay_tools.errors import SmartPlayError
from smartplay_tools.web.store import FullError

T = TypeVar("T")

LARGEST_BODY = 64 * 1024
"""Bytes; a call's arguments are malformed beyond 10,000 characters."""

TOO_LARGE = PlainTextResponse("Request body too large", 413)
UNAUTHORIZED = PlainTextResponse("Unauthorized", 401, headers={"WWW-Authenticate": "Bearer"})


async def read_body(request: Request) -> bytes | None:
    """The body of a request; None if it is too large."""
    body = b""
    async for chunk in request.stream():
        body += chunk
        if len(body) > LARGEST_BODY:
            return None
    return body


async def asked(ask: Callable[[str], T | None], handle: str) -> T | Response:
    """Find an episode, in a thread because it may have to be replayed first; return a refusal if there is none."""
    try:
        found = await asyncio.to_thread(ask, handle)
    except FullError as error:
        return PlainTextResponse(str(error), 503)
    except SmartPlayError:
        return PlainTextResponse("The record of this episode cannot be continued", 500)
    return PlainTextResponse("No such episode", 404) if found is None else found
