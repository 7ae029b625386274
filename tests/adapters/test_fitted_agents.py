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
from tests.adapters.fitted_fuzz import check_some
from tests.manager.fuzz import Rewritten
from tests.manager.histories import Messages, text_of_page
from tests.manager.judge import is_broken

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


def check(model: Reader) -> None:
    """Every prompt is under its cap by a fresh count of what was sent, whole and with its task."""
    assert len(model.sent) == PAGES + 1
    schema = sp.ToolSpec(read.name, read.description, read.params_json_schema)
    for items in model.sent:
        counted = sp.ContextManager(None).fit(items, tools=[schema], system=SYSTEM, form="responses")
        assert (counted.tokens <= CAP, counted.repaired, counted.made) == (True, [], 0)
        assert not is_broken("responses", items)
        assert items[0]["content"] == TASK
    assert len(model.sent[-1]) < PAGES


async def run(model: Reader, manager: sp.ContextManager, *, streamed: bool = False, **options: Any) -> Any:
    agent = Agent("reader", instructions=SYSTEM, model=ContextManagerModel(model, manager), tools=[read])
    if not streamed:
        return await Runner.run(agent, TASK, max_turns=200, **options)
    result = Runner.run_streamed(agent, TASK, max_turns=200, **options)
    async for _ in result.stream_events():
        pass
    return result


@pytest.mark.parametrize("streamed", [False, True])
@pytest.mark.parametrize("slack", [0, 0.5])
async def test_an_agent_stays_under_its_cap(slack: float, streamed: bool):
    model = Reader()
    result = await run(model, sp.ContextManager(CAP, slack=slack), streamed=streamed)
    assert result.final_output == "Done."
    assert len(result.to_input_list()) > PAGES * 2
    check(model)


async def test_a_compactor_rewrites_what_the_model_is_sent_and_asks_another():
    asked: list[Messages] = []

    async def ask(messages: Messages, max_tokens: int) -> str:
        asked.append(messages)
        return "Pages were read."

    model = Reader()
    await run(model, sp.ContextManager(CAP, strategy=Rewritten, question_tokens=4_000, ask=ask))
    check(model)
    assert 0 < len(asked) < PAGES
    assert "So far: Pages were read." in str(model.sent[-1])
    assert all("So far" not in str(item) for items in model.sent for item in items[2:])


async def test_a_session_keeps_everything():
    model, session = Reader(), SQLiteSession("book")
    await run(model, sp.ContextManager(CAP), session=session)
    results = [item for item in await session.get_items() if item.get("type") == "function_call_output"]
    assert len(results) == PAGES + 2 * (PAGES // 7)
    assert not any("tokens cut]" in str(item["output"]) for item in results)
    check(model)


async def test_the_filter_does_the_same_where_it_is_told_the_tools():
    model, manager = Reader(), sp.ContextManager(CAP)
    agent = Agent("reader", instructions=SYSTEM, model=model, tools=[read])
    config = RunConfig(call_model_input_filter=window_filter(manager, tools=[read]))
    await Runner.run(agent, TASK, max_turns=200, run_config=config)
    check(model)
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


async def test_sub_agents_have_managers_of_their_own():
    inner, outer = Reader(), ScriptedModel()
    outer.enqueue([function_call("ask", '{"input": "Read all pages."}', call_id="a")])
    outer.enqueue([assistant_message("Read.")])
    sub = Agent("reader", instructions=SYSTEM, model=ContextManagerModel(inner, sp.ContextManager(CAP)), tools=[read])
    ask = sub.as_tool("ask", "Ask the reader.", max_turns=200)
    agent = Agent("chief", model=ContextManagerModel(outer, sp.ContextManager(300)), tools=[ask])
    result = await Runner.run(agent, TASK)
    assert result.final_output == "Read."
    check(inner)


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


async def test_a_summary_is_shown_and_not_stored():
    async def ask(messages: Messages, max_tokens: int) -> str:
        return "Nothing but doors."

    model = Reader()
    result = await run(model, sp.ContextManager(CAP, strategy=sp.Summaries(60), ask=ask))
    check(model)
    assert model.sent[-1][1]["content"].endswith("Nothing but doors.")
    assert "Nothing but doors." not in str(result.to_input_list())


async def test_prompts_of_random_conversations_have_no_fault():
    await check_some("agents")
