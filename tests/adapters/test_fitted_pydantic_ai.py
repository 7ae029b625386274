"""Agents of Pydantic AI that play no game, held to a budget by the context manager."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Any

import pytest

pytest.importorskip("pydantic_ai", reason="needs smartplay-tools[pydantic-ai]; `.ci/run` has an environment with it")

from pydantic import BaseModel
from pydantic_ai import Agent, RunContext
from pydantic_ai.capabilities import AbstractCapability, ProcessHistory, WebSearch
from pydantic_ai.messages import (
    ModelMessage,
    ModelRequest,
    ModelResponse,
    TextPart,
    ThinkingPart,
    ToolCallPart,
    ToolReturnPart,
    UserPromptPart,
)
from pydantic_ai.models import ModelRequestContext
from pydantic_ai.models.function import AgentInfo, DeltaToolCall, FunctionModel
from pydantic_ai.models.test import TestModel
from pydantic_ai.usage import UsageLimits
from smartplay_pydantic_ai import ContextManagerCapability

import smartplay_tools as sp
from tests.adapters.book import CAP, PAGES, SYSTEM, TASK, pages_of
from tests.adapters.fitted import Book, FittedConformance
from tests.manager.histories import text_of_page

pytestmark = pytest.mark.filterwarnings("ignore")

NO_LIMIT = UsageLimits(request_limit=None)


def read(page: int) -> str:
    """Read a page."""
    return text_of_page(page)


class Reader:
    """Reads page after page, several at once now and then, and keeps what it is sent."""

    def __init__(self, pages: int = PAGES) -> None:
        self.pages = pages
        self.sent: list[list[ModelMessage]] = []
        self.infos: list[AgentInfo] = []
        self.model = FunctionModel(self.answer, stream_function=self.stream)

    def answer(self, messages: list[ModelMessage], info: AgentInfo) -> ModelResponse:
        self.sent.append(messages)
        self.infos.append(info)
        turn = len(self.sent)
        pages = pages_of(turn, self.pages)
        calls = [ToolCallPart("read", {"page": page}, f"c{page}") for page in pages]
        return ModelResponse(
            [ThinkingPart("The next page."), TextPart("Next."), *calls] if calls else [TextPart("Done.")]
        )

    async def stream(self, messages: list[ModelMessage], info: AgentInfo) -> AsyncIterator[Any]:
        parts = self.answer(messages, info).parts
        for at, part in enumerate(parts):
            if isinstance(part, TextPart) and len(parts) == 1:  # with a call after them, words would end the run
                yield part.content
            elif isinstance(part, ToolCallPart):
                yield {at: DeltaToolCall(part.tool_name, part.args_as_json_str(), tool_call_id=part.tool_call_id)}


def agent(reader: Reader, *others: Any, manager: sp.ContextManager | None = None, **options: Any) -> Agent[None, Any]:
    capability = ContextManagerCapability(manager or sp.ContextManager(CAP))
    return Agent(
        reader.model, instructions=SYSTEM, tools=[read], capabilities=[*others, capability], retries=3, **options
    )


def specs(info: AgentInfo) -> list[sp.ToolSpec]:
    tools = [*info.function_tools, *info.output_tools]
    return [sp.ToolSpec(tool.name, tool.description or "", tool.parameters_json_schema) for tool in tools]


def book(reader: Reader, stored: list[ModelMessage]) -> Book:
    info = reader.infos[0]
    return Book(reader.sent, stored, specs(info), info.instructions or "")


class TestPydanticAI(FittedConformance):
    framework = "pydantic-ai"

    async def read(self, manager: sp.ContextManager, *, streamed: bool = False) -> Book:
        reader = Reader()
        made = agent(reader, manager=manager)
        if not streamed:
            return book(reader, (await made.run(TASK, usage_limits=NO_LIMIT)).all_messages())
        async with made.run_stream(TASK, usage_limits=NO_LIMIT) as stream:
            assert "".join([piece async for piece in stream.stream_text(delta=True)]) == "Done."
        return book(reader, stream.all_messages())

    async def read_by_sub_agent(self, manager: sp.ContextManager, chief: sp.ContextManager) -> Book:
        books: list[Book] = []

        async def ask(page: int) -> str:
            books.append(await self.read(manager))
            return "Read."

        outer = Agent(Reader(1).model, tools=[], capabilities=[ContextManagerCapability(chief)])
        outer.tool_plain(ask, name="read")
        assert (await outer.run(TASK)).output == "Done."
        (read_book,) = books
        return read_book


def test_a_history_goes_on_in_another_run():
    reader = Reader()
    reader.pages = 20
    first = agent(reader).run_sync(TASK, usage_limits=NO_LIMIT)
    reader.pages = PAGES
    reader.sent.pop()
    reader.infos.pop()
    result = agent(reader).run_sync("Go on.", message_history=first.all_messages(), usage_limits=NO_LIMIT)
    TestPydanticAI().check(book(reader, result.all_messages()))
    assert any(getattr(part, "content", "") == "Go on." for message in reader.sent[-1] for part in message.parts)


@pytest.mark.parametrize("is_first", [True, False])
def test_what_other_capabilities_add_is_under_the_cap(is_first: bool):
    class Reminds(AbstractCapability[Any]):
        async def prepare_model_request(self, ctx: RunContext[Any], request_context: ModelRequestContext) -> Any:
            words = ModelRequest([UserPromptPart("Remember the page. " * 20)])
            request_context.messages = [*request_context.messages, words]
            return request_context

    reader = Reader()
    others = [Reminds(), ProcessHistory(lambda messages: messages)]
    if is_first:
        result = agent(reader, *others).run_sync(TASK, usage_limits=NO_LIMIT)
    else:
        first = ContextManagerCapability(sp.ContextManager(CAP))
        made = Agent(reader.model, instructions=SYSTEM, tools=[read], capabilities=[first, *others])
        result = made.run_sync(TASK, usage_limits=NO_LIMIT)
    TestPydanticAI().check(book(reader, result.all_messages()))
    assert all("Remember the page." in str(messages[-1]) for messages in reader.sent)


def test_results_and_words_in_one_request_are_put_together_again():
    reader = Reader(0)
    calls = [ToolCallPart("read", {"page": n}, f"c{n}") for n in (1, 2)]
    results = [ToolReturnPart("read", f"Page {n}.", f"c{n}") for n in (1, 2)]
    mixed = ModelRequest([results[0], UserPromptPart("Hurry."), results[1]])
    history = [ModelRequest([UserPromptPart(TASK)]), ModelResponse(calls), mixed, ModelResponse([TextPart("Yes.")])]
    agent(reader).run_sync("So?", message_history=history)
    (sent,) = reader.sent
    assert [getattr(part, "content", None) for part in sent[2].parts] == ["Page 1.", "Page 2.", "Hurry."]
    assert mixed.parts == [results[0], UserPromptPart("Hurry.", timestamp=mixed.parts[1].timestamp), results[1]]
    assert sent[1].parts == calls


def test_output_tools_instructions_and_tools_of_a_provider_count():
    class Answer(BaseModel):
        """What the book says, in the words of its author, with the number of the page where it says so."""

        words: str
        page: int

    with pytest.raises(sp.PromptOverflowError, match="tools 82"):
        agent(Reader(0), manager=sp.ContextManager(100), output_type=Answer).run_sync(TASK)
    agent(Reader(0), manager=sp.ContextManager(100)).run_sync(TASK)
    searching = Agent(TestModel(), capabilities=[WebSearch(), ContextManagerCapability(sp.ContextManager(100))])
    with pytest.raises(sp.InvalidArgumentError, match="web_search"):
        searching.run_sync(TASK)


def test_a_result_that_is_an_error_is_cut_as_it_is_sent():
    reader, text = Reader(0), '"quoted" \\ ' * 400
    call = ToolCallPart("read", {"page": 1}, "c1")
    failed = ToolReturnPart("read", text, "c1", outcome="failed")
    history = [ModelRequest([UserPromptPart(TASK)]), ModelResponse([call]), ModelRequest([failed])]
    agent(reader).run_sync("So?", message_history=history)
    ((_, _, request, *_),) = reader.sent
    assert request.parts[0].model_response_str().startswith('{"error":')
    assert request.parts[0].model_response_str().endswith("tokens cut]")
