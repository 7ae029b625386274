"""A host's agent as small as can be: it keeps its messages, sends all of them, and runs the calls that come back.

As a program, it plays where its environment says: to the end, or the number of turns that is its first argument. With
a second argument it does not end by itself.
"""

from __future__ import annotations

import itertools
import json
import os
import sys
import time
from collections.abc import Callable
from typing import Any

import httpx2
import openai
from smartplay_openai import WindowEndpoint

import smartplay_tools as sp

Run = Callable[[str, Any], str]
"""Runs a tool call and returns its text."""


def own_tools() -> list[dict[str, Any]]:
    with sp.Episode("Hanoi3Disk-v0", seed=0) as episode:
        return [sp.schema(tool, "openai") for tool in episode.tools]


TOOLS = own_tools()


def for_messages(tools: list[dict[str, Any]]) -> list[Any]:
    """The tools as Anthropic has them."""
    functions = [tool["function"] for tool in tools]
    return [
        {"name": function["name"], "description": function["description"], "input_schema": function["parameters"]}
        for function in functions
    ]


MESSAGES_TOOLS = for_messages(TOOLS)
WORDS = [
    {"role": "system", "content": "You are a helpful agent with a long prompt of your own."},
    {"role": "user", "content": "Play."},
]


class Elsewhere:
    """An episode of an endpoint in another process."""

    def __init__(self, base_url: str, model: str, mcp_url: str) -> None:
        self.base_url, self._model, self._mcp_url = base_url, model, mcp_url

    def model(self, handle: str) -> str:
        return self._model

    def mcp_url(self, handle: str) -> str:
        return self._mcp_url


class HostAgent:
    """The agent. `post` sends a request and returns the message that came back."""

    def __init__(self, endpoint: WindowEndpoint | Elsewhere, handle: str, *, tools: list[Any] | None = None) -> None:
        self.url, self.model = endpoint.base_url, endpoint.model(handle)
        self.mcp_url = endpoint.mcp_url(handle)
        self.messages: list[dict[str, Any]] = list(WORDS)
        self.tools = TOOLS if tools is None else tools
        self._ids = itertools.count(1)

    def request(self, **fields: Any) -> dict[str, Any]:
        return {"model": self.model, "messages": list(self.messages), "tools": self.tools, **fields}

    def post(self, body: dict[str, Any] | None = None, **options: Any) -> dict[str, Any]:
        answer = httpx2.post(
            f"{self.url}/chat/completions", json=body or self.request(), timeout=60, trust_env=False, **options
        )
        assert answer.status_code == 200, answer.text
        message: dict[str, Any] = answer.json()["choices"][0]["message"]
        return message

    def run(self, name: str, arguments: Any, *, key: str | None = None) -> str:
        params = {"name": name, "arguments": arguments} | ({"_meta": {"smartplay/call-id": key}} if key else {})
        asked = {"jsonrpc": "2.0", "id": next(self._ids), "method": "tools/call", "params": params}
        answer = httpx2.post(self.mcp_url, json=asked, timeout=60, trust_env=False).json()
        text: str = answer["result"]["content"][0]["text"]
        return text

    def run_named(self, name: str, **arguments: Any) -> str:
        return self.run(name, arguments)

    def answer(self, message: dict[str, Any]) -> None:
        """Run the calls of a message and keep their results."""
        self.messages.append(message)
        for call in message.get("tool_calls", ()):
            text = self.run(call["function"]["name"], json.loads(call["function"]["arguments"]))
            self.messages.append({"role": "tool", "tool_call_id": call["id"], "content": text})

    def play(self, turns: int = 100) -> dict[str, Any]:
        """Play until the endpoint says that the game is over; return its last words."""
        for _ in range(turns):
            message = self.post()
            if "tool_calls" not in message:
                return message
            self.answer(message)
        raise AssertionError("the game does not end")


def openai_client(endpoint: WindowEndpoint) -> openai.OpenAI:
    http = openai.DefaultHttpxClient(trust_env=False)
    return openai.OpenAI(base_url=endpoint.base_url, api_key="none", http_client=http)


def anthropic_client(endpoint: WindowEndpoint) -> Any:
    import anthropic  # here, because programs of this file start often and do not need it

    http = anthropic.DefaultHttpxClient(trust_env=False)
    return anthropic.Anthropic(base_url=endpoint.url, api_key="none", http_client=http)


def client_of(interface: str, endpoint: WindowEndpoint) -> Any:
    return (anthropic_client if interface == "messages" else openai_client)(endpoint)


def by_chat(client: Any, model: str, tools: dict[str, Any], stream: bool, offered: list[Any] = TOOLS) -> None:
    messages: list[Any] = list(WORDS)
    for _ in range(60):
        asked = {"model": model, "messages": messages, "tools": offered}
        if stream:
            with client.chat.completions.stream(**asked) as parts:
                message = parts.get_final_completion().choices[0].message
        else:
            message = client.chat.completions.create(**asked).choices[0].message
        if not message.tool_calls:
            return
        messages.append(message.model_dump(exclude_none=True, exclude={"parsed"}))
        for call in message.tool_calls:
            text = tools[call.function.name](**json.loads(call.function.arguments))
            messages.append({"role": "tool", "tool_call_id": call.id, "content": text})


def by_responses(client: Any, model: str, tools: dict[str, Any], stream: bool, offered: list[Any] = TOOLS) -> None:
    items: list[Any] = [*WORDS]
    flat = [{"type": "function", **tool["function"]} for tool in offered]
    for _ in range(60):
        asked = {"model": model, "input": items, "tools": flat, "store": False}
        if stream:
            with client.responses.stream(**asked) as parts:
                response = parts.get_final_response()
        else:
            response = client.responses.create(**asked)
        calls = [item for item in response.output if item.type == "function_call"]
        if not calls:
            return
        items += [item.model_dump(exclude={"parsed_arguments"}) for item in response.output]
        for call in calls:
            text = tools[call.name](**json.loads(call.arguments))
            items.append({"type": "function_call_output", "call_id": call.call_id, "output": text})


def by_messages(client: Any, model: str, tools: dict[str, Any], stream: bool, offered: list[Any] = TOOLS) -> None:
    messages: list[Any] = [{"role": "user", "content": "Play."}]
    for _ in range(60):
        asked = {"model": model, "max_tokens": 1000, "system": "Be quick.", "messages": messages}
        asked["tools"] = for_messages(offered)
        if stream:
            with client.messages.stream(**asked) as parts:
                message = parts.get_final_message()
        else:
            message = client.messages.create(**asked)
        calls = [block for block in message.content if block.type == "tool_use"]
        assert message.stop_reason == ("tool_use" if calls else "end_turn")
        if not calls:
            return
        messages.append({"role": "assistant", "content": message.content})
        texts = [tools[call.name](**call.input) for call in calls]
        results = [{"type": "tool_result", "tool_use_id": call.id} for call in calls]
        content = [{**result, "content": text} for result, text in zip(results, texts, strict=True)]
        messages.append({"role": "user", "content": content})


INTERFACES: dict[str, Callable[..., None]] = {"chat": by_chat, "responses": by_responses, "messages": by_messages}
"""Plays an episode through OpenAI's or Anthropic's client to the end."""


if __name__ == "__main__":
    there = Elsewhere(*(os.environ[name] for name in ("OPENAI_BASE_URL", "OPENAI_MODEL", "SMARTPLAY_MCP_URL")))
    program = HostAgent(there, os.environ["SMARTPLAY_HANDLE"])
    if len(sys.argv) == 1:
        program.play()
    for _ in range(int(*sys.argv[1:2])):
        program.answer(program.post())
    if len(sys.argv) > 2:
        time.sleep(600)
