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
from typing import Any, ClassVar, NamedTuple

import httpx2
import openai
from smartplay_gateway import LocalEndpoint, WindowEndpoint

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
            f"{self.url}/chat/completions",
            json=body or self.request(),
            timeout=60,
            trust_env=False,
            verify=False,
            **options,
        )
        assert answer.status_code == 200, answer.text
        message: dict[str, Any] = answer.json()["choices"][0]["message"]
        return message

    def run(self, name: str, arguments: Any, *, key: str | None = None) -> str:
        params = {"name": name, "arguments": arguments} | ({"_meta": {"smartplay/call-id": key}} if key else {})
        asked = {"jsonrpc": "2.0", "id": next(self._ids), "method": "tools/call", "params": params}
        answer = httpx2.post(self.mcp_url, json=asked, timeout=60, trust_env=False, verify=False).json()
        text: str = answer["result"]["content"][0]["text"]
        return text

    def run_named(self, name: str, **arguments: Any) -> str:
        return self.run(name, arguments)

    def answer(self, message: dict[str, Any], *, key: str | None = None) -> str:
        """Run the calls of a message and keep their results; return the last."""
        self.messages.append(message)
        for call in message.get("tool_calls", ()):
            text = self.run(call["function"]["name"], json.loads(call["function"]["arguments"]), key=key)
            self.messages.append({"role": "tool", "tool_call_id": call["id"], "content": text})
        return str(self.messages[-1]["content"])

    def play(self, turns: int = 100) -> dict[str, Any]:
        """Play until the endpoint says that the game is over; return its last words."""
        for _ in range(turns):
            message = self.post()
            if "tool_calls" not in message:
                return message
            self.answer(message)
        raise AssertionError("the game does not end")


def scripted(*messages: sp.Message, **options: Any) -> tuple[WindowEndpoint, sp.ScriptedPlayer]:
    """A window endpoint whose model says these messages."""
    player = sp.ScriptedPlayer(messages)
    return WindowEndpoint(player, **options), player


def openai_client(endpoint: WindowEndpoint | LocalEndpoint) -> openai.OpenAI:
    http = openai.DefaultHttpxClient(trust_env=False, verify=False)
    return openai.OpenAI(base_url=endpoint.base_url, api_key="none", http_client=http)


def anthropic_client(endpoint: WindowEndpoint) -> Any:
    import anthropic  # here, because programs of this file start often and do not need it

    http = anthropic.DefaultHttpxClient(trust_env=False, verify=False)
    return anthropic.Anthropic(base_url=endpoint.url, api_key="none", http_client=http)


def client_of(interface: str, endpoint: WindowEndpoint) -> Any:
    return (anthropic_client if interface == "messages" else openai_client)(endpoint)


class Answer(NamedTuple):
    """What came back to a request."""

    text: str
    calls: list[tuple[str, str, dict[str, Any]]]
    """Id, name and arguments of each."""
    usage: sp.Usage
    items: list[Any]
    """What the host keeps of it."""


class ByChat:
    """Chat completions with OpenAI's client. Each of these interfaces asks, and spells what is asked."""

    begin: ClassVar[list[Any]] = WORDS
    picture: ClassVar[list[Any]] = [
        {"type": "text", "text": "Here."},
        {"type": "image_url", "image_url": {"url": "data:image/png;base64,AAAA"}},
    ]
    no_calls: ClassVar[Any] = "none"

    def __init__(self, client: Any, model: str, stream: bool) -> None:
        self.client, self.model, self.stream = client, model, stream

    def ask(self, messages: list[Any], offered: list[Any], **extra: Any) -> Answer:
        asked = {"model": self.model, "messages": messages, "extra_body": extra} | (
            {"tools": offered} if offered else {}
        )
        if self.stream:
            with self.client.chat.completions.stream(**asked, stream_options={"include_usage": True}) as parts:
                completion = parts.get_final_completion()
        else:
            completion = self.client.chat.completions.create(**asked)
        message, usage = completion.choices[0].message, completion.usage
        calls = [(c.id, c.function.name, json.loads(c.function.arguments)) for c in message.tool_calls or ()]
        cached = usage.prompt_tokens_details.cached_tokens
        spent = sp.Usage(prompt=usage.prompt_tokens, reply=usage.completion_tokens, cached=cached)
        return Answer(message.content or "", calls, spent, [message.model_dump(exclude_none=True, exclude={"parsed"})])

    def results(self, texts: list[tuple[str, Any]]) -> list[Any]:
        return [{"role": "tool", "tool_call_id": call_id, "content": text} for call_id, text in texts]

    def schema(self, schema: Any) -> dict[str, Any]:
        return {"response_format": {"type": "json_schema", "json_schema": {"name": "answer", "schema": schema}}}


class ByResponses(ByChat):
    """Responses with OpenAI's client."""

    picture: ClassVar[list[Any]] = [
        {"type": "input_text", "text": "Here."},
        {"type": "input_image", "image_url": "data:image/png;base64,AAAA"},
    ]

    def ask(self, messages: list[Any], offered: list[Any], **extra: Any) -> Answer:
        tools = [{"type": "function", **tool["function"]} for tool in offered]
        asked = {"model": self.model, "input": messages, "tools": tools, "store": False, "extra_body": extra}
        if self.stream:
            with self.client.responses.stream(**asked) as parts:
                response = parts.get_final_response()
        else:
            response = self.client.responses.create(**asked)
        items = [item.model_dump(exclude={"parsed_arguments"}) for item in response.output]
        functions = [item for item in response.output if item.type == "function_call"]
        usage = response.usage
        cached = usage.input_tokens_details.cached_tokens
        spent = sp.Usage(prompt=usage.input_tokens, reply=usage.output_tokens, cached=cached)
        calls = [(item.call_id, item.name, json.loads(item.arguments)) for item in functions]
        return Answer(response.output_text, calls, spent, items)

    def results(self, texts: list[tuple[str, Any]]) -> list[Any]:
        return [{"type": "function_call_output", "call_id": call_id, "output": text} for call_id, text in texts]

    def schema(self, schema: Any) -> dict[str, Any]:
        return {"text": {"format": {"type": "json_schema", "name": "answer", "schema": schema}}}


class ByMessages(ByChat):
    """Messages with Anthropic's client."""

    begin: ClassVar[list[Any]] = [{"role": "user", "content": "Play."}]
    picture: ClassVar[list[Any]] = [
        {"type": "text", "text": "Here."},
        {"type": "image", "source": {"type": "base64", "media_type": "image/png", "data": "AAAA"}},
    ]
    no_calls: ClassVar[Any] = {"type": "none"}

    def ask(self, messages: list[Any], offered: list[Any], **extra: Any) -> Answer:
        asked = {"model": self.model, "max_tokens": 1000, "system": "Be quick.", "messages": messages}
        asked |= {"tools": for_messages(offered), "extra_body": extra}
        if self.stream:
            with self.client.messages.stream(**asked) as parts:
                message = parts.get_final_message()
        else:
            message = self.client.messages.create(**asked)
        calls = [(block.id, block.name, block.input) for block in message.content if block.type == "tool_use"]
        assert message.stop_reason == ("tool_use" if calls else "end_turn")
        text = "".join(block.text for block in message.content if block.type == "text")
        cached = message.usage.cache_read_input_tokens
        spent = sp.Usage(prompt=message.usage.input_tokens + cached, reply=message.usage.output_tokens, cached=cached)
        return Answer(text, calls, spent, [{"role": "assistant", "content": message.content}])

    def results(self, texts: list[tuple[str, Any]]) -> list[Any]:
        content = [{"type": "tool_result", "tool_use_id": call_id, "content": text} for call_id, text in texts]
        return [{"role": "user", "content": content}]

    def schema(self, schema: Any) -> dict[str, Any]:
        return {"output_config": {"format": {"type": "json_schema", "schema": schema}}}


INTERFACES: dict[str, type[ByChat]] = {"chat": ByChat, "responses": ByResponses, "messages": ByMessages}
"""OpenAI's or Anthropic's client at an episode: `INTERFACES[name](client, model, stream)`."""


def play_through(
    asks: ByChat,
    tools: dict[str, Any],
    offered: list[Any] = TOOLS,
    later: list[Any] | None = None,
    *,
    forgets: bool = False,
    **extra: Any,
) -> tuple[str, sp.Usage]:
    """Play an episode through a client to the end; return the last words and the usage of all answers.

    `later` are the tools of all requests but the first, by default the same. A host that `forgets` keeps no more than
    its first messages and the latest reply with its results.
    """
    messages, usage = [*asks.begin], sp.Usage(requests=0)
    for _ in range(60):
        answer = asks.ask(messages, offered, **extra)
        usage += answer.usage
        if not answer.calls:
            return answer.text, usage
        results = asks.results([(call_id, tools[name](**arguments)) for call_id, name, arguments in answer.calls])
        offered = offered if later is None else later
        messages = [*(asks.begin if forgets else messages), *answer.items, *results]
    raise AssertionError("the game does not end")


if __name__ == "__main__":
    there = Elsewhere(*(os.environ[name] for name in ("OPENAI_BASE_URL", "OPENAI_MODEL", "SMARTPLAY_MCP_URL")))
    program = HostAgent(there, os.environ["SMARTPLAY_HANDLE"])
    if len(sys.argv) == 1:
        program.play()
    for _ in range(int(*sys.argv[1:2])):
        program.answer(program.post())
    if len(sys.argv) > 2:
        time.sleep(600)
