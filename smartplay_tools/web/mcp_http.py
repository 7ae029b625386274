"""The endpoint of agents, `/mcp`: a POST has a JSON-RPC message, the response its answer.

The MCP server and the window endpoint both have it.
"""

from __future__ import annotations

import base64
import binascii
import json
import re
from typing import Any

from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route

from smartplay_tools.web import mcp
from smartplay_tools.web.bodies import Bounded
from smartplay_tools.web.mcp import ProtocolError, respond
from smartplay_tools.web.store import Hosted, NotServedError, Store

__all__ = ["bind_episode", "mcp_route"]

HOSTED = "smartplay_hosted_episode"
"""The key of the episode in a request's scope."""

STATUS = {mcp.METHOD_NOT_FOUND: 404}
"""Since 2026-07-28 errors also have a status: 404 for unknown methods, 400 for everything else."""


async def bind_episode(request: Request, store: Store[Any]) -> Response | None:
    """Bind a request to the episode that it names, for the route; return a refusal if there is none."""
    handle = request.url.path.lstrip("/").partition("/")[2].removesuffix("/mcp")  # some clients append it
    handle = handle or request.query_params.get("episode") or request.headers.get("x-episode") or ""
    try:
        request.scope[HOSTED] = await store.asked_for(handle)
    except NotServedError as error:
        return PlainTextResponse(str(error), error.status)
    request.scope["path"] = "/mcp"
    return None


def mcp_route() -> Route:
    """Return the route of messages to episodes, for an application whose guard calls `bind_episode`."""
    return Route("/mcp", _answer, methods=["POST"], middleware=[Middleware(Bounded)])


async def _answer(request: Request) -> Response:
    """Answer a message to the episode in the request's scope."""
    if request.headers.get("content-type", "").partition(";")[0].strip().lower() != "application/json":
        return PlainTextResponse("Send application/json", 415)
    hosted: Hosted = request.scope[HOSTED]
    stateless = request.headers.get("mcp-protocol-version") in mcp.STATELESS_VERSIONS
    try:
        message = json.loads(await request.body())
        _check_headers(request, message)
    except ProtocolError as error:
        request_id = message.get("id") if isinstance(message, dict) else None
        return _json(error.body(request_id), 400)
    except (ValueError, RecursionError):
        return _json(ProtocolError(mcp.PARSE_ERROR, "The body is not JSON.").body(None), 400)
    answer = await respond(hosted, message)
    if answer is None:
        return Response(status_code=202)
    code = answer.get("error", {}).get("code")
    is_refused = code is not None and (stateless or answer["id"] is None)
    return _json(answer, STATUS.get(code, 400) if is_refused else 200)


def _check_headers(request: Request, message: Any) -> None:
    """Check that the headers, which proxies use for routing, agree with the body."""
    version = request.headers.get("mcp-protocol-version")
    if version is not None and version not in (*mcp.HANDSHAKE_VERSIONS, *mcp.STATELESS_VERSIONS):
        supported = {"supported": [*mcp.STATELESS_VERSIONS], "requested": version}
        raise ProtocolError(mcp.UNSUPPORTED_VERSION, "Unsupported protocol version", supported)
    if version not in mcp.STATELESS_VERSIONS or not isinstance(message, dict) or "id" not in message:
        return
    if not isinstance(message.get("method"), str):
        return  # no request, which is said in the answer
    params = message.get("params")
    meta = params.get("_meta") if isinstance(params, dict) else None
    if not isinstance(params, dict) or not isinstance(meta, dict) or mcp.VERSION_KEY not in meta:
        raise ProtocolError(mcp.INVALID_PARAMS, f"params._meta has no {mcp.VERSION_KEY}.")
    expected = {"mcp-protocol-version": meta[mcp.VERSION_KEY], "mcp-method": message["method"]}
    if message["method"] == "tools/call" and params.get("name") is not None:
        expected["mcp-name"] = params["name"]
    for header, value in expected.items():
        if _decoded(request.headers.get(header)) != value:
            raise ProtocolError(mcp.HEADER_MISMATCH, f"The header {header} does not agree with the body.")


def _decoded(value: str | None) -> str | None:
    """A header's value, decoded from base64 if it is not plain ASCII."""
    match = re.fullmatch(r"=\?base64\?(.*)\?=", value or "")
    if match is None:
        return value
    try:
        return base64.b64decode(match[1], validate=True).decode()
    except (binascii.Error, UnicodeDecodeError):
        return None


def _json(answer: Any, status: int) -> Response:
    # ASCII, because a message may contain a lone surrogate, which UTF-8 cannot encode.
    return Response(json.dumps(answer), status, media_type="application/json")
