"""The interfaces at which hosts ask the window endpoint: how each reads a request and writes an answer.

OpenAI's two write as the local endpoint does, and read less strictly. Each has its own ids of calls and form of errors.
"""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

from smartplay_openai.chat import CHAT
from smartplay_openai.interface import Event
from smartplay_openai.problems import RequestError, bad, read_tools
from smartplay_openai.window.completion_request import CompletionRequest, Ignored, json_schema, objects
from smartplay_tools import Message, Usage

SUB_AGENT_HEADERS = ("x-claude-code-agent-id", "x-openai-subagent")
"""Headers that Claude Code and Codex send with the requests of sub-agents only."""


class HostFormat(ABC):
    """An interface at which hosts ask for the model's reply."""

    path: ClassVar[str]

    @abstractmethod
    def read(self, body: Mapping[str, Any], headers: Mapping[str, str]) -> CompletionRequest:
        """Return what a request says; raise `RequestError` for tools that cannot be shown to the model."""

    @abstractmethod
    def write(self, message: Message, usage: Usage, body: Mapping[str, Any]) -> dict[str, Any]:
        """Return the answer to a request that says a message."""

    @abstractmethod
    def stream(self, answer: dict[str, Any], body: Mapping[str, Any]) -> Iterator[Event]:
        """Yield an answer's events."""

    def refusal(self, error: RequestError) -> dict[str, Any]:
        """Return the body of an error."""
        return error.body()


class ChatFormat(HostFormat):
    """Chat completions."""

    path = CHAT.path

    def read(self, body: Mapping[str, Any], headers: Mapping[str, str]) -> CompletionRequest:
        """Return what a request says."""
        if not isinstance(body.get("messages"), list):
            raise bad("messages is a list.", "messages")
        if body.get("n") not in (None, 1):
            raise bad("This endpoint gives one choice: n is 1.", "n")
        functions, left_out = functions_of(body)
        ignored = Ignored(fields=fields_of(body, {"messages", "tools", "stream_options"}))
        results, system = dict[str, Any](), list[str]()
        for message in objects(body["messages"]):
            role, content = str(message.get("role")), message.get("content")
            if role == "tool":
                results[str(message.get("tool_call_id"))] = content
            elif role != "assistant" or not message.get("tool_calls"):
                text = ignored.hear(role, content)
                system += [text] if role in ("system", "developer") else []
        return CompletionRequest(
            read_tools({"tools": functions}, "function"),
            results,
            json.dumps(body),
            ignored,
            "\n\n".join(system),
            left_out,
            forbids_calls=body.get("tool_choice") == "none",
            answer_schema=json_schema(body.get("response_format")),
            is_of_sub_agent=any(name in headers for name in SUB_AGENT_HEADERS),
            messages=body["messages"],
        )

    def write(self, message: Message, usage: Usage, body: Mapping[str, Any]) -> dict[str, Any]:
        """Return the completion."""
        return CHAT.write(message, str(body["model"]), usage)

    def stream(self, answer: dict[str, Any], body: Mapping[str, Any]) -> Iterator[Event]:
        """Yield the completion's chunks."""
        return CHAT.stream(answer, body)


def functions_of(body: Mapping[str, Any]) -> tuple[list[Any], list[str]]:
    """Return a request's functions, and what its other tools are: run by the provider, or called with free text."""
    tools = body.get("tools")
    if not isinstance(tools, list | None):
        raise bad("tools is a list.", "tools")
    functions, left_out = [], []
    for tool in tools or ():
        kind = tool.get("type") if isinstance(tool, Mapping) else None
        if isinstance(kind, str) and kind != "function":
            inner = tool.get(kind)
            name = tool.get("name") or (inner.get("name") if isinstance(inner, Mapping) else None)
            left_out.append(f"{name} ({kind})" if name else kind)
        else:
            functions.append(tool)
    return functions, left_out


def fields_of(body: Mapping[str, Any], used: set[str]) -> list[str]:
    """Return the names of a request's fields that have no effect."""
    unused = {field for field, value in body.items() if value is not None and value is not False}
    return sorted(unused - used - {"model", "stream"})


CHAT_FORMAT = ChatFormat()
