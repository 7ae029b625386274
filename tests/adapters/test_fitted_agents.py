"""Agents of OpenAI's Agents SDK that play no game, held to a budget by the context manager."""

from __future__ import annotations

import json
from typing import Any

import pytest
from agents import (
    Agent,
    RunConfig,
    Runner,
    SQLiteSession,
    WebSearchTool,
    function_tool,
    handoff,
    set_tracing_disabled,
)
from agents.testing import ScriptedModel, assistant_message, function_call
from pydantic import BaseModel
from smartplay_openai.fitting import ContextManagerModel, window_filter

import smartplay_tools as sp
from tests.adapters.book import CAP, PAGES, SYSTEM, TASK, pages_of
from tests.adapters.fitted import Book, FittedConformance
from tests.manager.histories import Messages, text_of_page

set_tracing_disabled(True)


@function_tool
def read(page: int) -> str:
    """Read a page."""
    return text_of_page(page)


class Reader(ScriptedModel):
    """The SDK's scripted model: it reads page after page, several at once now and then."""

    def __init__(self, pages: int = PAGES) -> None:
        super().__init__()
        for turn in range(1, pages + 1):
            self.enqueue(
                [function_call("read", json.dumps({"page": page}), call_id=f"c{page}") for page in pages_of(turn)]
            )
        self.enqueue([assistant_message("Done.")])

    @property
    def sent(self) -> list[Messages]:
        return [
            [{"type": "message", **dict(item)} if "type" not in item else dict(item) for item in call.input]
            for call in self.calls
        ]


async def run(model: Reader, manager: sp.ContextManager, *, streamed: bool = False, **options: Any) -> Any:
    agent = Agent("reader", instructions=SYSTEM, model=ContextManagerModel(model, manager), tools=[read])
    if not streamed:
        return await Runner.run(agent, TASK, max_turns=200, **options)
    result = Runner.run_streamed(agent, TASK, max_turns=200, **options)
    async for _ in result.stream_events():
        pass
    return result


class TestAgents(FittedConformance):
    framework = "agents"

    async def read(self, manager: sp.ContextManager, *, streamed: bool = False) -> Book:
        model = Reader()
        result = await run(model, manager, streamed=streamed)
        assert result.final_output == "Done."
        schema = sp.ToolSpec(read.name, read.description, read.params_json_schema)
        return Book(model.sent, result.to_input_list(), [schema], SYSTEM)

    async def read_by_sub_agent(self, manager: sp.ContextManager, chief: sp.ContextManager) -> Book:
        inner, outer = Reader(), ScriptedModel()
        outer.enqueue([function_call("ask", '{"input": "Read all pages."}', call_id="a")])
        outer.enqueue([assistant_message("Read.")])
        reader = Agent("reader", instructions=SYSTEM, model=ContextManagerModel(inner, manager), tools=[read])
        ask = reader.as_tool("ask", "Ask the reader.", max_turns=200)
        agent = Agent("chief", model=ContextManagerModel(outer, chief), tools=[ask])
        assert (await Runner.run(agent, TASK)).final_output == "Read."
        schema = sp.ToolSpec(read.name, read.description, read.params_json_schema)
        return Book(inner.sent, [], [schema], SYSTEM)


async def test_a_session_keeps_everything():
    model, session = Reader(), SQLiteSession("book")
    await run(model, sp.ContextManager(CAP), session=session)
    results = [item for item in await session.get_items() if item.get("type") == "function_call_output"]
    assert len(results) == PAGES + 2 * (PAGES // 7)
    assert not any("tokens cut]" in str(item["output"]) for item in results)


async def test_the_filter_does_the_same_where_it_is_told_the_tools():
    model, manager = Reader(), sp.ContextManager(CAP)
    agent = Agent("reader", instructions=SYSTEM, model=model, tools=[read])
    config = RunConfig(call_model_input_filter=window_filter(manager, tools=[read]))
    await Runner.run(agent, TASK, max_turns=200, run_config=config)
    wrapped = Reader()
    await run(wrapped, sp.ContextManager(CAP))
    assert wrapped.sent == model.sent


async def test_handoffs_and_the_output_schema_count():
    class Answer(BaseModel):
        words: str

    other = Agent("writer", handoff_description="Writes a long letter to the author of the book.")
    for options in ({"output_type": Answer}, {"handoffs": [handoff(other)]}, {"tools": [read]}):
        agent = Agent("reader", model=ContextManagerModel(Reader(0), sp.ContextManager(20)), **options)
        with pytest.raises(sp.PromptOverflowError, match=r"tools [1-9]"):
            await Runner.run(agent, TASK)


@pytest.mark.parametrize("option", ["previous_response_id", "conversation_id"])
async def test_what_a_server_keeps_is_refused(option: str):
    agent = Agent("reader", model=ContextManagerModel(Reader(0), sp.ContextManager(CAP)))
    with pytest.raises(sp.InvalidArgumentError, match=option):
        await Runner.run(agent, TASK, **{option: "r1"})


async def test_tools_that_a_provider_runs_need_their_tokens():
    agent = Agent("reader", model=ContextManagerModel(Reader(0), sp.ContextManager(CAP)), tools=[WebSearchTool()])
    with pytest.raises(sp.InvalidArgumentError, match="web_search"):
        await Runner.run(agent, TASK)
    named = ContextManagerModel(Reader(0), sp.ContextManager(CAP, extra_tokens=300))
    result = await Runner.run(Agent("reader", model=named, tools=[WebSearchTool()]), TASK)
    assert result.final_output == "Done."
