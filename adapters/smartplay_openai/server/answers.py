"""The responses of both endpoints: JSON, streams of events, refusals as OpenAI words them."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Iterator, Mapping
from typing import Any, TypeVar

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response

from smartplay_openai.interface import Event
from smartplay_openai.problems import RequestError
from smartplay_tools import SmartPlayError
from smartplay_tools.types.json_text import object_in

T = TypeVar("T")


async def read_request(request: Request, read: Callable[[dict[str, Any]], T], *, at_once: int = 0) -> T:
    """Return what a function makes of the object that a request holds; `RequestError` for anything else.

    It works in a thread, because a long conversation takes long to read, and others play meanwhile. A body of at most
    `at_once` bytes is read here, where the switch to a thread would take longer.
    """
    sent = await request.body()

    def read_body() -> T:
        body = object_in(sent)
        if body is None:
            raise RequestError(400, "The body of a request is a JSON object.")
        try:
            return read(body)
        except RecursionError:
            raise RequestError(400, "The body is nested too deeply.") from None
        except SmartPlayError as error:
            raise RequestError(400, str(error)) from error

    return read_body() if len(sent) <= at_once else await asyncio.to_thread(read_body)


WRONG_KEY = RequestError(
    401,
    "The API key is wrong or missing.",
    code="invalid_api_key",
    headers={"www-authenticate": "Bearer", "x-should-retry": "false"},
)
"""The refusal of a request without the key."""


def json_response(body: Mapping[str, Any], status: int = 200, headers: Mapping[str, str] | None = None) -> Response:
    """Return a body as a response."""
    # ASCII, since a message may hold half a character, which UTF-8 cannot.
    return Response(json.dumps(body), status, headers, media_type="application/json")


def event_stream(events: Iterator[Event]) -> Iterator[str]:
    """Yield events as server-sent events."""
    for name, data in events:
        text = data if isinstance(data, str) else json.dumps(data)
        yield f"event: {name}\ndata: {text}\n\n" if name else f"data: {text}\n\n"


async def refuse(request: Request, error: RequestError) -> Response:
    """Answer a request that is refused."""
    return json_response(error.body(), error.status, error.headers)


async def fail(request: Request, error: Exception) -> Response:
    """Answer a request at which the server failed."""
    return json_response(RequestError(500, f"{type(error).__name__}: {error}").body(), 500)


async def refuse_http(request: Request, error: HTTPException) -> Response:
    """Answer a request to a path or with a method that is not served."""
    refused = RequestError(error.status_code, f"{error.detail}: {request.method} {request.url.path}")
    return json_response(refused.body(), error.status_code, error.headers)


def model_object(name: str) -> dict[str, Any]:
    """Return a model's entry in the list of models."""
    return {"id": name, "object": "model", "created": 0, "owned_by": "smartplay-tools"}


HANDLERS: dict[Any, Any] = {RequestError: refuse, HTTPException: refuse_http, Exception: fail}
"""How an application answers exceptions."""
