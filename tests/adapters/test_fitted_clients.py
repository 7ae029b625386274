"""Loops of one's own with OpenAI's and Anthropic's clients, held to a budget by the context manager."""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator
from typing import Any, ClassVar

import pytest
from anthropic import Anthropic, AsyncAnthropic
from openai import AsyncOpenAI, OpenAI

import smartplay_tools as sp
from tests.adapters.anthropic_stub import AnthropicStub
from tests.adapters.book import CAP, PAGES, SYSTEM, TASK, pages_of
from tests.adapters.openai_stub import OpenAIStub
from tests.dialects.rules import DIALECTS
from tests.dialects.said import read_messages
from tests.manager.histories import text_of_page
from tests.manager.judge import is_broken

SCHEMA = {"type": "object", "properties": {"page": {"type": "integer"}}, "required": ["page"]}
SPEC = sp.ToolSpec("read", "Read a page.", SCHEMA)
FUNCTION = {"name": SPEC.name, "description": SPEC.description, "parameters": SCHEMA}


def script() -> Iterator[dict[str, Any]]:
    """Reads page after page, several at once now and then."""
    for turn in range(1, PAGES + 1):
        pages = pages_of(turn)
        calls = [{"name": "read", "arguments": json.dumps({"page": page})} for page in pages]
        made = [{"id": f"c{page}", "type": "function", "function": c} for page, c in zip(pages, calls, strict=True)]
        yield {"role": "assistant", "content": "Next.", "tool_calls": made}
    yield {"role": "assistant", "content": "Done."}


class Messages(AnthropicStub):
    """Accepts words of the user after others, as Anthropic does."""

    def check(self, path: str, body: dict[str, Any]) -> None:
        turns = read_messages(body)
        for rule in DIALECTS["Anthropic"].rules("refuses"):
            assert rule.act(turns, body, {}) is None, rule.rule


class Loop:
    """A loop as the documentation of a client has it: its objects are what the list keeps."""

    def __init__(self, manager: sp.ContextManager) -> None:
        self.manager = manager
        self.messages: list[Any] = []

    def settled(self) -> None:
        """Check that the list has everything, and that fitting has changed nothing."""
        assert sum(len(self.results(message)) for message in self.messages) == PAGES + 2 * (PAGES // 7)
        assert all(text_of_page(page) == text for message in self.messages for page, text in self.results(message))

    def results(self, message: Any) -> list[tuple[int, str]]:
        raise NotImplementedError


class Chat(Loop):
    form, field = "chat", "messages"
    tools: ClassVar[Any] = [{"type": "function", "function": FUNCTION}]

    def begin(self) -> None:
        self.messages = [{"role": "system", "content": SYSTEM}, {"role": "user", "content": TASK}]

    def request(self) -> dict[str, Any]:
        prompt = self.manager.fit(self.messages, tools=self.tools)
        return {"model": "m", "messages": prompt.messages, "tools": self.tools}

    def take(self, response: Any) -> bool:
        reply = response.choices[0].message
        self.messages.append(reply)
        for call in reply.tool_calls or ():
            text = text_of_page(json.loads(call.function.arguments)["page"])
            self.messages.append({"role": "tool", "tool_call_id": call.id, "content": text})
        return bool(reply.tool_calls)

    def results(self, message: Any) -> list[tuple[int, str]]:
        is_result = isinstance(message, dict) and message["role"] == "tool"
        return [(int(message["tool_call_id"][1:]), message["content"])] if is_result else []


class Responses(Loop):
    form, field = "responses", "input"
    tools: ClassVar[Any] = [{"type": "function", **FUNCTION}]

    def begin(self) -> None:
        self.messages = [{"type": "message", "role": "user", "content": TASK}]

    def request(self) -> dict[str, Any]:
        prompt = self.manager.fit(self.messages, tools=self.tools, system=SYSTEM)
        return {"model": "m", "input": prompt.messages, "tools": self.tools, "instructions": SYSTEM}

    def take(self, response: Any) -> bool:
        self.messages += response.output
        calls = [item for item in response.output if item.type == "function_call"]
        for call in calls:
            output = {"call_id": call.call_id, "output": text_of_page(json.loads(call.arguments)["page"])}
            self.messages.append({"type": "function_call_output", **output})
        return bool(calls)

    def results(self, message: Any) -> list[tuple[int, str]]:
        is_result = isinstance(message, dict) and message["type"] == "function_call_output"
        return [(int(message["call_id"][1:]), message["output"])] if is_result else []


class Blocks(Loop):
    form, field = "anthropic", "messages"
    tools: ClassVar[Any] = [{"name": SPEC.name, "description": SPEC.description, "input_schema": SCHEMA}]

    def begin(self) -> None:
        self.messages = [{"role": "user", "content": TASK}]

    def request(self) -> dict[str, Any]:
        prompt = self.manager.fit(self.messages, tools=self.tools, system=SYSTEM)
        return {"model": "m", "max_tokens": 50, "messages": prompt.messages, "tools": self.tools, "system": SYSTEM}

    def take(self, response: Any) -> bool:
        self.messages.append({"role": "assistant", "content": response.content})
        calls = [block for block in response.content if block.type == "tool_use"]
        results = [
            {"type": "tool_result", "tool_use_id": c.id, "content": text_of_page(c.input["page"])} for c in calls
        ]
        self.messages += [{"role": "user", "content": results}] if results else []
        return bool(calls)

    def results(self, message: Any) -> list[tuple[int, str]]:
        blocks = message["content"] if message["role"] == "user" and isinstance(message["content"], list) else []
        return [(int(block["tool_use_id"][1:]), block["content"]) for block in blocks]


LOOPS: dict[str, tuple[type[Any], Any, Any, Any]] = {
    "chat": (Chat, OpenAIStub, OpenAI, AsyncOpenAI),
    "responses": (Responses, OpenAIStub, OpenAI, AsyncOpenAI),
    "anthropic": (Blocks, Messages, Anthropic, AsyncAnthropic),
}


def check(loop: Any, bodies: list[dict[str, Any]]) -> None:
    """Every request is under its cap by a fresh count of what was sent, whole and with its task."""
    assert len(bodies) == PAGES + 1
    for body in bodies:
        sent = body[loop.field]
        system = SYSTEM if loop.form != "chat" else None
        counted = sp.ContextManager(None, form=loop.form).fit(sent, tools=body["tools"], system=system)
        assert (counted.tokens <= CAP, counted.repaired, counted.made) == (True, [], 0)
        assert not is_broken(loop.form, sent)
        assert TASK in [message.get("content") for message in sent[:2]]
    assert len(bodies[-1][loop.field]) < PAGES
    loop.settled()


def ask(messages: Any, max_tokens: int) -> str:
    return "Nothing but doors."


OPTIONS: dict[str, dict[str, Any]] = {
    "whole": {},
    "masked": {"history": 3, "beyond_history": "mask", "own_words": 2},
    "summaries": {"strategy": sp.Summaries(60), "ask": ask},
}


async def sent_by(form: str, options: str = "whole", *, is_async: bool = False) -> list[dict[str, Any]]:
    """The bodies of a loop's requests; each is checked."""
    kind, stub, client_of, async_client_of = LOOPS[form]
    with stub(script()) as server:
        loop = kind(sp.ContextManager(CAP, **OPTIONS[options]))
        loop.begin()
        client = (async_client_of if is_async else client_of)(
            api_key="-", base_url=getattr(server, "base_url", server.url)
        )
        create = {"chat": lambda c: c.chat.completions, "responses": lambda c: c.responses}.get(form)
        asked = create(client) if create else client.messages
        more = True
        while more:
            response = asked.create(**loop.request())
            more = loop.take(await response if is_async else response)
        await client.close() if is_async else client.close()
        check(loop, server.bodies)
        return copy.deepcopy(server.bodies)


@pytest.mark.parametrize("options", OPTIONS)
@pytest.mark.parametrize("form", LOOPS)
async def test_a_loop_stays_under_its_cap(form: str, options: str):
    bodies = await sent_by(form, options)
    assert ("Nothing but doors." in str(bodies[-1])) == (options == "summaries")


@pytest.mark.parametrize("form", LOOPS)
async def test_an_asynchronous_loop_sends_the_same(form: str):
    assert await sent_by(form, is_async=True) == await sent_by(form)
