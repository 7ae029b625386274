"""What a server takes in: requests that come whole, in time and in limited size; and the responses to others."""

from __future__ import annotations

import asyncio

from starlette.responses import PlainTextResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

LARGEST_CALL = 64 * 1024
"""The most bytes of a body; a call's arguments are malformed beyond 10,000 characters."""

LARGEST_REQUEST = 4 * 1024 * 1024
"""The most bytes of a request to a model, which holds a whole conversation."""

PATIENCE = 30.0
"""Seconds in which the head of a request has to come, and after it the body."""

UNAUTHORIZED = PlainTextResponse("Unauthorized", 401, headers={"WWW-Authenticate": "Bearer"})


class Bounded:
    """An application whose requests arrive whole; a body that is too large or does not come in time is refused.

    A body that is too large is read to its end and dropped: a client listens for the answer when it has sent
    everything.

    Arguments:
        app: the application.
        largest: the most bytes of a body.
    """

    def __init__(self, app: ASGIApp, largest: int = LARGEST_CALL) -> None:
        self._app, self._largest = app, largest

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        parts, size, is_whole = [], 0, False
        try:
            async with asyncio.timeout(PATIENCE):
                while not is_whole:
                    message = await receive()
                    if message["type"] == "http.disconnect":
                        return
                    size += len(message.get("body", b""))
                    if size <= self._largest:
                        parts.append(message.get("body", b""))
                    is_whole = not message.get("more_body", False)
        except TimeoutError:
            pass  # what came is answered below
        except asyncio.CancelledError:  # the server stops, and does not wait for the rest
            await _refusal(503, "The server stops.")(scope, receive, send)
            return
        if size > self._largest:
            await _refusal(413, f"The body of a request has at most {self._largest:,} bytes.")(scope, receive, send)
        elif not is_whole:
            await _refusal(408, f"The body of a request comes within {PATIENCE:g} seconds.")(scope, receive, send)
        else:
            whole: list[Message] = [{"type": "http.request", "body": b"".join(parts), "more_body": False}]

            async def receive_whole() -> Message:
                return whole.pop() if whole else await receive()

            await self._app(scope, receive_whole, send)


def _refusal(status: int, text: str) -> Response:
    return PlainTextResponse(text, status, headers={"Connection": "close"})
