"""Responses at the window: the items of a request, and tools in namespaces.

Codex sends the tools of an MCP server as one tool of the type `namespace`. Its functions are flattened, with the
namespace before their names, and a call carries both apart again. What is stored at a provider (`previous_response_id`,
`conversation`) is not needed here: the ids of the calls whose results a request has say where it is.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from itertools import groupby
from typing import Any

from smartplay_gateway.window.formats import (
    CompletionRequest,
    HostFormat,
    Ignored,
    fields_of,
    functions_of,
    json_schema,
    messages_of,
)
from smartplay_tools import Message, Usage
from smartplay_tools.players.wire import RESPONSES, Event, RequestError, objects, read_tools

BETWEEN = "__"
"""The separator between a namespace and the name of its function."""

USED = {"input", "instructions", "tools", "previous_response_id", "conversation", "parallel_tool_calls"}
SILENT = ("function_call", "function_call_output", "message")
"""Items that are read, or told of as messages."""


class ResponsesFormat(HostFormat):
    """Responses."""

    path = RESPONSES.path

    def read(self, body: Mapping[str, Any]) -> CompletionRequest:
        """Return what a request says."""
        items = messages_of(body, "input")
        tools, _ = flat_tools(body)
        functions, left_out = functions_of({"tools": tools})
        ignored = Ignored(fields=fields_of(body, USED))
        system = [ignored.hear("system", body["instructions"])] if body.get("instructions") else []
        system += _hear(items, ignored)
        calls = [item for item in objects(items) if item.get("type") == "function_call"]
        text = body.get("text")
        return CompletionRequest(
            read_tools({"tools": functions}, None, strict=False),
            {
                str(item.get("call_id")): item.get("output")
                for item in objects(items)
                if item.get("type") == "function_call_output"
            },
            json.dumps(body),
            ignored,
            "\n\n".join(system),
            left_out,
            {str(call.get("call_id")): (_flat_name(call), call.get("arguments")) for call in calls},
            one_call=body.get("parallel_tool_calls") is False,
            forbids_calls=body.get("tool_choice") == "none",
            answer_schema=json_schema(text.get("format") if isinstance(text, Mapping) else None),
            messages=() if body.get("previous_response_id") or body.get("conversation") else items,
        )

    def write(self, message: Message, usage: Usage, body: Mapping[str, Any]) -> dict[str, Any]:
        """Return the response; calls of a namespace carry its name and their own apart."""
        if thoughts := message.get("reasoning_content"):
            summary = [{"type": "summary_text", "text": thoughts}]
            message = {**message, "provider_items": [{"type": "reasoning", "summary": summary}]}
        answer = RESPONSES.write(message, str(body["model"]), usage)
        _, apart = flat_tools(body)
        for item in answer["output"]:
            if item["type"] == "function_call" and item["name"] in apart:
                item["namespace"], item["name"] = apart[item["name"]]
        return answer

    def stream(self, answer: dict[str, Any], body: Mapping[str, Any]) -> Iterator[Event]:
        """Yield the response's events."""
        return RESPONSES.stream(answer, body)

    def failure(self, error: RequestError) -> Event:
        """Return the event of a stream that ends without a response."""
        return RESPONSES.failure(error)


def _flat_name(function: Mapping[str, Any]) -> str:
    """The name of a function or a call, with that of its namespace before it."""
    return BETWEEN.join(str(function[part]) for part in ("namespace", "name") if function.get(part))


def flat_tools(body: Mapping[str, Any]) -> tuple[Any, dict[str, tuple[str, str]]]:
    """Return a request's tools, those of namespaces flattened, and the namespaced name behind each flat name."""
    tools = body.get("tools")
    if not isinstance(tools, list):
        return tools, {}
    flat: list[Any] = []
    apart: dict[str, tuple[str, str]] = {}
    for tool in tools:
        if not isinstance(tool, Mapping) or tool.get("type") != "namespace":
            flat.append(tool)
            continue
        for inner in objects(tool.get("tools")):
            name = f"{tool.get('name')}{BETWEEN}{inner.get('name')}"
            apart[name] = str(tool.get("name")), str(inner.get("name"))
            flat.append({**inner, "name": name})
    return flat, apart


def _hear(items: list[Any], ignored: Ignored) -> list[str]:
    """Count the parts of the items that do not reach the model; return the system texts.

    Consecutive items of the assistant are one reply; one without a call is the host's, because ours have calls.
    """
    system = []
    for is_reply, group in groupby(objects(items), _is_of_assistant):
        heard = list(group)
        if is_reply and any(item.get("type") == "function_call" for item in heard):
            heard = [item for item in heard if item.get("type") not in (None, "message")]
        for item in heard:
            kind = str(item.get("type") or "message")
            if kind == "message":
                role = str(item.get("role"))
                text = ignored.hear(role, item.get("content"))
                system += [text] if role in ("system", "developer") else []
            elif kind not in SILENT:
                ignored.kinds[kind] += 1
    return system


def _is_of_assistant(item: Mapping[str, Any]) -> bool:
    return item.get("type") != "function_call_output" and item.get("role", "assistant") == "assistant"


RESPONSES_FORMAT = ResponsesFormat()
