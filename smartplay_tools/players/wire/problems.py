"""Errors of requests in OpenAI's form, and the checks that find them.

A local endpoint that accepted everything would hide mistakes until the real service is used. It therefore refuses what
is commonly refused there: calls without results, results without calls, tools in the form of the other interface,
strict schemas that are not strict, and invalid names and ids.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

from smartplay_tools.players.conversion import check_names
from smartplay_tools.types import ToolSpec
from smartplay_tools.types.messages import Message, calls_of


class RequestError(Exception):
    """A request that is refused: an HTTP status, and a message for people."""

    def __init__(
        self,
        status: int,
        message: str,
        *,
        param: str | None = None,
        code: str | None = None,
        headers: Mapping[str, str] | None = None,
    ) -> None:
        super().__init__(message)
        self.status, self.param, self.code = status, param, code
        self._kind = "invalid_request_error" if status < 500 else "server_error"
        # Without a time to retry, the same request would be refused again, so clients should not retry it.
        self.headers = headers or {"x-should-retry": "false"}

    def body(self) -> dict[str, Any]:
        """Return the JSON body of the error."""
        return {"error": {"message": str(self), "type": self._kind, "param": self.param, "code": self.code}}


def bad(message: str, param: str) -> RequestError:
    """Return an error with status 400."""
    return RequestError(400, message, param=param)


def objects(values: Any) -> list[Mapping[str, Any]]:
    """Return the objects in a list; nothing if it is not one, as anything may be sent in its place."""
    return [value for value in values if isinstance(value, Mapping)] if isinstance(values, list) else []


def check_calls(messages: Sequence[Message], param: str) -> None:
    """Check that every call has one result before the next other message, and every result a call."""
    waiting: set[str] = set()
    for at, message in enumerate(messages):
        where = f"{param}[{at}]"
        if message["role"] == "tool":
            call_id = message.get("tool_call_id", "")
            if call_id not in waiting:
                raise bad(f"The tool result {call_id!r} does not follow a tool call of that id.", where)
            waiting.remove(call_id)
        elif waiting:
            raise bad(f"The tool calls {', '.join(sorted(waiting))} have no result.", where)
        for call in calls_of(message):
            if not call["id"] or call["id"] in waiting:
                raise bad(f"The tool call id {call['id']!r} is empty or repeated.", where)
            check_name(call["function"]["name"], where)
            waiting.add(call["id"])
    if waiting:
        raise bad(f"The tool calls {', '.join(sorted(waiting))} have no result.", param)


def check_name(name: Any, param: str) -> None:
    """Check a tool's name."""
    if not isinstance(name, str) or not re.fullmatch(r"[A-Za-z0-9_-]{1,64}", name):
        raise bad(f"A tool's name has 1 to 64 letters, digits, _ and -; {name!r} is none.", param)


def read_tools(body: Mapping[str, Any], function_field: str | None, *, strict: bool = True) -> tuple[ToolSpec, ...]:
    """Return a request's tools; `function_field` is the field of the function, None if it is next to the type.

    What only OpenAI would refuse is refused if `strict`: a name or a schema of another form.
    """
    tools = body.get("tools")
    if not isinstance(tools, list | None):
        raise bad("tools is a list.", "tools")
    specs = tuple(_read_tool(tool, function_field, f"tools[{at}]", strict) for at, tool in enumerate(tools or ()))
    check_names((spec.name, spec) for spec in specs)
    return specs


def _read_tool(tool: Any, function_field: str | None, param: str, strict: bool) -> ToolSpec:
    kind = tool.get("type") if isinstance(tool, Mapping) else None
    is_function = kind == "function"
    if isinstance(kind, str) and not is_function:
        raise bad(f"A tool of the type {kind!r} cannot be counted or run here: send functions only.", param)
    function = (tool.get(function_field) if function_field else tool) if is_function else None
    if not isinstance(function, Mapping) or "name" not in function:
        raise bad("A tool has a name: in chat completions under `function`, in Responses next to `type`.", param)
    if strict or not (isinstance(function["name"], str) and function["name"]):
        check_name(function["name"], param)
    parameters = function.get("parameters") or {"type": "object", "properties": {}}
    if not isinstance(parameters, Mapping) or parameters.get("type", None if strict else "object") != "object":
        raise bad("A tool's parameters are a JSON Schema of type object.", param)
    properties, required = parameters.get("properties") or {}, parameters.get("required") or ()
    if not isinstance(properties, Mapping) or not _are_names(required):
        raise bad("A tool's properties are an object, and required is a list of their names.", param)
    closed = parameters.get("additionalProperties") is False
    if strict and function.get("strict") and not (closed and set(required) == set(properties)):
        raise bad("A strict tool requires all its properties and sets additionalProperties to false.", param)
    return ToolSpec(function["name"], str(function.get("description") or ""), parameters)


def _are_names(value: Any) -> bool:
    return isinstance(value, list | tuple) and all(isinstance(name, str) for name in value)


def read_limit(body: Mapping[str, Any], *names: str) -> int | None:
    """Return the cap on the reply, which may have any of these names."""
    for name in names:
        limit = body.get(name)
        if limit is not None:
            if not isinstance(limit, int) or isinstance(limit, bool) or limit < 1:
                raise bad(f"{name} is a number of at least 1, not {limit!r}.", name)
            return limit
    return None
