"""The Model Context Protocol for one game: answers to JSON-RPC messages, without I/O.

A game is a small server: three tools that never change, a text, no session, and no requests to clients.
This module implements the part of the protocol that it needs, for both generations: the handshake (`initialize`, up to
2025-11-25) and, since 2026-07-28, requests that each name their version. It does not use the official package, because
importing it takes longer than hosts wait for a server, and because agent frameworks pin conflicting versions of it.

The text of a result is for the model. It is in two places, because some hosts show the content blocks to the model,
others only the structured content. Score and reward are in neither; they are in the transcript.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from smartplay_tools.types import ToolResult, ToolSpec
    from smartplay_tools.web.store import Hosted

__all__ = ["CALL_KEY", "INTERNAL_ERROR", "PARSE_ERROR", "ProtocolError", "respond"]

CALL_KEY = "smartplay/call-id"
"""A field of a request's `_meta`: an idempotency key, for callers that repeat a call whose answer was lost."""

HANDSHAKE_VERSIONS = ("2024-11-05", "2025-03-26", "2025-06-18", "2025-11-25")
"""Versions of the protocol that begin with `initialize`, oldest first."""

STATELESS_VERSIONS = ("2026-07-28",)
"""Versions of the protocol in which every request names its version in `_meta`."""

ALWAYS_LOAD = "anthropic/alwaysLoad"
"""A field of a tool's `_meta`: Claude Code then shows the tool to the model instead of hiding it behind a search."""

VERSION_KEY = "io.modelcontextprotocol/protocolVersion"
CAPABILITIES_KEY = "io.modelcontextprotocol/clientCapabilities"
SERVER_KEY = "io.modelcontextprotocol/serverInfo"

PARSE_ERROR, INVALID_REQUEST, METHOD_NOT_FOUND, INVALID_PARAMS, INTERNAL_ERROR = -32700, -32600, -32601, -32602, -32603
HEADER_MISMATCH, UNSUPPORTED_VERSION = -32020, -32022

SERVER_INFO = {"name": "smartplay", "title": "SmartPlay", "version": version("smartplay-tools")}
INSTRUCTIONS = (
    "This server is one game, to be played until it is over. Read the manual first with `read_manual`; `observe` shows "
    "the current observation, `act` plays one action and shows what happened. When a result says that the game is "
    "over, stop calling tools."
)
"""A text that hosts may put into the system prompt."""

TITLES = {"observe": "Observe", "act": "Act", "read_manual": "Read the manual"}

OUTPUT_SCHEMA: dict[str, Any] = {
    "type": "object",
    "properties": {
        "text": {"type": "string", "description": "What the tool says, as in the text content."},
        "step": {"type": "integer", "description": "How many actions have been played."},
        "done": {"type": "boolean", "description": "Whether the game is over."},
        "is_error": {"type": "boolean", "description": "Whether the call was refused."},
    },
    "required": ["text", "step", "done", "is_error"],
    "additionalProperties": False,
}
"""JSON Schema of a tool result's structured content."""

ABOUT: dict[str, Any] = {"capabilities": {"tools": {"listChanged": False}}, "instructions": INSTRUCTIONS}
"""What the server says of itself."""

CACHEABLE = {"server/discover", "tools/list"}
"""Methods whose results state, since 2026-07-28, how long they may be cached."""


class ProtocolError(Exception):
    """A request that cannot be answered, as a JSON-RPC error."""

    def __init__(self, code: int, message: str, data: Any = None) -> None:
        super().__init__(message)
        self.code, self.data = code, data

    def body(self, request_id: Any) -> dict[str, Any]:
        """Return the error message."""
        error = {"code": self.code, "message": str(self)} | ({} if self.data is None else {"data": self.data})
        return {"jsonrpc": "2.0", "id": request_id, "error": error}


async def respond(hosted: Hosted, message: Any) -> dict[str, Any] | None:
    """Return the answer to a message; None for a notification, which has none."""
    if not isinstance(message, dict) or message.get("jsonrpc") != "2.0" or not isinstance(message.get("method"), str):
        return ProtocolError(INVALID_REQUEST, "Send one JSON-RPC request at a time.").body(None)
    request_id = message.get("id")
    if "id" not in message:
        return None
    if isinstance(request_id, bool) or not isinstance(request_id, str | int):
        return ProtocolError(INVALID_REQUEST, "The id of a request is a string or an integer.").body(None)
    try:
        params = message.get("params", {})
        if not isinstance(params, dict) or not isinstance(params.get("_meta", {}), dict):
            raise ProtocolError(INVALID_PARAMS, "params and its _meta are objects.")
        return {"jsonrpc": "2.0", "id": request_id, "result": await _answer(hosted, message["method"], params)}
    except ProtocolError as error:
        return error.body(request_id)


async def _answer(hosted: Hosted, method: str, params: dict[str, Any]) -> dict[str, Any]:
    meta: dict[str, Any] = params.get("_meta", {})
    if method == "initialize":
        return _initialized(params)
    if VERSION_KEY not in meta:
        return {} if method == "ping" else await result_of(hosted, method, params)
    _check_version(meta)
    return stateless_result(method, await result_of(hosted, method, params))


def stateless_result(method: str, result: Mapping[str, Any]) -> dict[str, Any]:
    """Return a result with the fields that the protocol requires since 2026-07-28."""
    stamped = {**result, "resultType": "complete", "_meta": {SERVER_KEY: SERVER_INFO}}
    # The contents never change, but another agent may not be allowed to see them.
    return stamped | ({"ttlMs": 0, "cacheScope": "private"} if method in CACHEABLE else {})


def _initialized(params: Mapping[str, Any]) -> dict[str, Any]:
    requested = params.get("protocolVersion")
    if not isinstance(requested, str):
        raise ProtocolError(INVALID_PARAMS, "initialize names a protocolVersion.")
    agreed = requested if requested in HANDSHAKE_VERSIONS else HANDSHAKE_VERSIONS[-1]
    return {"protocolVersion": agreed, "serverInfo": SERVER_INFO, **ABOUT}


def _check_version(meta: Mapping[str, Any]) -> None:
    requested = meta[VERSION_KEY]
    if CAPABILITIES_KEY not in meta or not isinstance(requested, str):
        raise ProtocolError(INVALID_PARAMS, f"_meta has the texts {VERSION_KEY} and the object {CAPABILITIES_KEY}.")
    if requested not in STATELESS_VERSIONS:
        supported = {"supported": [*STATELESS_VERSIONS], "requested": requested}
        raise ProtocolError(UNSUPPORTED_VERSION, "Unsupported protocol version", supported)


async def result_of(hosted: Hosted, method: str, params: Mapping[str, Any]) -> dict[str, Any]:
    """Return the result of a method; raise `ProtocolError` if the method or its parameters are invalid."""
    match method:
        case "server/discover":
            return {"supportedVersions": [*STATELESS_VERSIONS], **ABOUT}
        case "tools/list":
            return {"tools": [_tool(spec) for spec in (await hosted.ready()).tools]}
        case "tools/call":
            return await _call(hosted, params)
    raise ProtocolError(METHOD_NOT_FOUND, "Method not found", method[:80])


def _tool(spec: ToolSpec) -> dict[str, Any]:
    title, plays = TITLES.get(spec.name, spec.name), spec.name == "act"
    hints = {"readOnlyHint": not plays, "destructiveHint": False, "idempotentHint": not plays, "openWorldHint": False}
    return {
        "name": spec.name,
        "title": title,
        "description": spec.description,
        "inputSchema": dict(spec.parameters),
        "outputSchema": OUTPUT_SCHEMA,
        "annotations": {"title": title, **hints},
        "_meta": {ALWAYS_LOAD: True},
    }


async def _call(hosted: Hosted, params: Mapping[str, Any]) -> dict[str, Any]:
    if not isinstance(params.get("name"), str) or not isinstance(params.get("arguments"), dict | None):
        raise ProtocolError(INVALID_PARAMS, "tools/call has the name of a tool, and arguments that are an object.")
    key = params.get("_meta", {}).get(CALL_KEY)
    result = await hosted.call(params["name"], params.get("arguments"), key if isinstance(key, str) else None)
    return call_result(result)


def call_result(result: ToolResult) -> dict[str, Any]:
    """Return a result in the protocol's form: text and picture as content, the text in the structured content, too."""
    content: list[dict[str, Any]] = [{"type": "text", "text": result.text}]
    if result.picture is not None:
        content.append({"type": "image", "data": result.picture.base64, "mimeType": "image/png"})
    facts = {"step": result.data["step"], "done": result.done, "is_error": result.is_error}
    return {
        "content": content,
        "structuredContent": {"text": result.text, **facts},
        "isError": result.is_error,
    }
