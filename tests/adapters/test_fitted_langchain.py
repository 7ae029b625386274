"""Agents of LangChain and LangGraph that play no game, held to a budget by the context manager."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import pytest
from langchain.agents import create_agent
from langchain.agents.middleware import AgentMiddleware, ModelRequest
from langchain_core.language_models import BaseChatModel
from langchain_core.messages import (
    AIMessage,
    AIMessageChunk,
    BaseMessage,
    HumanMessage,
    SystemMessage,
    convert_to_openai_messages,
)
from langchain_core.outputs import ChatGeneration, ChatGenerationChunk, ChatResult
from langchain_core.prompt_values import ChatPromptValue
from langchain_core.tools import tool
from langgraph.checkpoint.memory import InMemorySaver
from pydantic import BaseModel
from smartplay_langchain import ContextManagerMiddleware, FittedModel

import smartplay_tools as sp
from smartplay_tools.context.tokens import TokenCounter
from smartplay_tools.manager.record import read_thread
from tests.adapters.book import CAP, PAGES, SYSTEM, TASK, pages_of
from tests.adapters.fitted import Book, FittedConformance
from tests.manager.histories import text_of_page

ASK = {"messages": [{"role": "user", "content": TASK}]}
LONG: Any = {"recursion_limit": 1_000}


@tool
def read(page: int) -> str:
    """Read a page."""
    return text_of_page(page)


class Reader(BaseChatModel):
    """Reads page after page, several at once now and then, and keeps what it is sent."""

    pages: int = PAGES
    sent: list[list[BaseMessage]] = []  # noqa: RUF012  # pydantic copies it
    tools: list[Any] = []  # noqa: RUF012

    @property
    def _llm_type(self) -> str:
        return "reader"

    def bind_tools(self, tools: Sequence[Any], **settings: Any) -> Any:
        self.tools[:] = tools
        return self.bind(**settings)

    def _reply(self, messages: list[BaseMessage]) -> AIMessage:
        self.sent.append(messages)
        turn = len(self.sent)
        pages = pages_of(turn, self.pages)
        calls = [{"name": "read", "args": {"page": page}, "id": f"c{page}"} for page in pages]
        return AIMessage("Next." if calls else "Done.", tool_calls=calls)

    def _generate(self, messages: list[BaseMessage], stop: Any = None, run_manager: Any = None, **_: Any) -> ChatResult:
        return ChatResult(generations=[ChatGeneration(message=self._reply(messages))])

    def _stream(self, messages: list[BaseMessage], *_: Any, **__: Any) -> Iterator[ChatGenerationChunk]:
        reply = self._reply(messages)
        pieces = [
            {"name": c["name"], "args": str(c["args"]).replace("'", '"'), "id": c["id"], "index": i}
            for i, c in enumerate(reply.tool_calls)
        ]
        yield ChatGenerationChunk(message=AIMessageChunk(reply.content, tool_call_chunks=pieces, chunk_position="last"))


SPEC = sp.ToolSpec(read.name, read.description, read.args_schema.model_json_schema())


def tokens(messages: Sequence[BaseMessage]) -> int:
    """A prompt's tokens by the counter for games, from messages converted by LangChain."""
    return TokenCounter().prompt(convert_to_openai_messages(list(messages)), [SPEC])


def agent(
    model: Reader, *, manager: sp.ContextManager | None = None, middlewares: Sequence[Any] = (), **options: Any
) -> Any:
    middleware = ContextManagerMiddleware(manager or sp.ContextManager(CAP, slack=0.5))
    return create_agent(model, [read], system_prompt=SYSTEM, middleware=[middleware, *middlewares], **options)


class TestLangChain(FittedConformance):
    framework = "langchain"

    async def read(self, manager: sp.ContextManager, *, streamed: bool = False) -> Book:
        model = Reader(sent=[], tools=[])
        reader = agent(model, manager=manager)
        if streamed:
            state = [state async for state in reader.astream(ASK, LONG, stream_mode="values")][-1]
        else:
            state = reader.invoke(ASK, LONG)
        return Book(model.sent, state["messages"], [SPEC])

    async def read_by_sub_agent(self, manager: sp.ContextManager, chief: sp.ContextManager) -> Book:
        books: list[Book] = []

        @tool("read")
        async def ask(page: int) -> str:
            """Have the book read."""
            books.append(await self.read(manager))
            return "Read."

        outer = Reader(sent=[], tools=[], pages=1)
        await create_agent(outer, [ask], middleware=[ContextManagerMiddleware(chief)]).ainvoke(ASK)
        (book,) = books
        return book


def test_an_agent_has_langchains_own_summaries_under_an_exact_cap():
    asked: list[int] = []

    def ask(messages: list[dict[str, Any]], max_tokens: int) -> str:
        asked.append(max_tokens)
        return "Pages were read."

    model = Reader(sent=[], tools=[])
    strategy = "langchain-summary:tokens=600,keep=4"
    manager = sp.ContextManager(CAP, strategy=strategy, question_tokens=4_000, ask=ask)
    state = agent(model, manager=manager).invoke(ASK, LONG)
    assert 0 < len(asked) < model.pages
    assert "Pages were read." in str(model.sent[-1])
    assert not any("Pages were read." in str(message.content) for message in state["messages"])
    assert all(tokens(messages) <= CAP for messages in model.sent)


def test_a_thread_goes_on_from_its_checkpoint_with_another_manager():
    """Two processes with one checkpointer show what one shows."""
    sent = []
    for is_interrupted in (False, True):
        model, saver = Reader(sent=[], tools=[]), InMemorySaver()
        config = {"configurable": {"thread_id": "1"}, "recursion_limit": 1_000}
        if is_interrupted:
            first = agent(model, checkpointer=saver)
            for _ in zip(first.stream(ASK, config), range(31), strict=False):
                pass
            agent(model, checkpointer=saver).invoke(None, config)
        else:
            agent(model, checkpointer=saver).invoke(ASK, config)
        sent.append([[message.content for message in messages] for messages in model.sent])
    assert sent[0] == sent[1]


def test_what_later_middlewares_add_is_under_the_cap():
    class Reminds(AgentMiddleware[Any, Any, Any]):
        def wrap_model_call(self, request: ModelRequest[Any], handler: Any) -> Any:
            return handler(request.override(messages=[*request.messages, HumanMessage("Remember the page. " * 20)]))

    model = Reader(sent=[], tools=[])
    agent(model, middlewares=[Reminds()]).invoke(ASK, LONG)
    assert all(messages[-1].content.startswith("Remember") and tokens(messages) <= CAP for messages in model.sent)


def test_tools_and_the_output_schema_count():
    class Answer(BaseModel):
        """What the book says, in the words of its author, with the number of the page where it says so."""

        words: str
        page: int

    model = Reader(sent=[], tools=[], pages=0)
    manager = sp.ContextManager(90)
    with pytest.raises(sp.PromptOverflowError):
        create_agent(model, [read], response_format=Answer, middleware=[ContextManagerMiddleware(manager)]).invoke(ASK)
    create_agent(model, [read], middleware=[ContextManagerMiddleware(manager)]).invoke(ASK)


def test_a_model_in_a_graph_built_by_hand_is_held_to_the_cap_too():
    model = Reader(sent=[], tools=[])
    fitted = FittedModel(model, sp.ContextManager(CAP)).bind_tools([read])
    messages: list[BaseMessage] = [SystemMessage(SYSTEM), HumanMessage("Read all pages.")]
    while calls := (reply := fitted.invoke(messages)).tool_calls:
        messages += [reply, *(read.invoke(call) for call in calls)]
    assert len(messages) - len(model.sent[-1]) > 0
    assert all(tokens(sent) <= CAP for sent in model.sent)


class Summary(BaseModel):
    """What the book says."""

    words: str


@pytest.mark.parametrize(
    "send",
    [
        lambda model, given: model.invoke(given, stop=["."]),
        lambda model, given: model.invoke(ChatPromptValue(messages=given)),
        lambda model, given: list(model.stream(given)),
        lambda model, given: model.batch([given]),
        lambda model, given: model.with_retry().invoke(given),
        lambda model, given: (model | (lambda reply: reply)).invoke(given),
        lambda model, given: list((model.with_config(tags=["a"]) | (lambda reply: reply)).stream(given)),
        lambda model, given: model.with_structured_output(Summary).invoke(given),
    ],
)
def test_no_method_of_a_model_passes_by_the_budget(send: Any):
    model = Reader(sent=[], tools=[], pages=0)
    given: list[BaseMessage] = [HumanMessage("Well?"), *[AIMessage("word " * 40), HumanMessage("So?")] * 5]
    send(FittedModel(model, sp.ContextManager(120)), given)
    assert (model.sent[0][0], 1 < len(model.sent[0]) < len(given)) == (given[0], True)


def test_what_is_no_runnables_way_to_send_is_refused_and_a_text_is_a_message():
    model = Reader(sent=[], tools=[], pages=0)
    fitted = FittedModel(model, sp.ContextManager(120))
    with pytest.raises(sp.InvalidArgumentError, match="generate would pass by the budget"):
        fitted.generate([[HumanMessage("Well?")]])
    fitted.invoke("Well?")
    assert model.sent == [[HumanMessage("Well?")]]
    assert fitted.pages == 0


def test_thoughts_and_extra_fields_count_and_stay():
    thought = AIMessage(
        [{"type": "thinking", "thinking": "hm " * 50, "signature": "s"}, {"type": "text", "text": "Yes."}]
    )
    bare = AIMessage("Yes.")
    model = Reader(sent=[], tools=[], pages=0)
    seen = []
    for reply in (thought, bare):
        manager = sp.ContextManager(CAP)
        FittedModel(model, manager).invoke([HumanMessage("Well?"), reply, HumanMessage("So?")])
        seen.append(model.sent[-1][1])
    assert seen[0] is thought
    with pytest.raises(sp.PromptOverflowError):
        FittedModel(model, sp.ContextManager(50)).invoke([HumanMessage("Well?"), thought])
    FittedModel(model, sp.ContextManager(50)).invoke([HumanMessage("Well?"), bare])


@pytest.mark.parametrize("name", ["bind", "bind_tools"])
def test_a_prompt_that_its_provider_was_asked_to_manage_is_recorded_as_such(name, tmp_path):
    class Counting(Reader):
        def _reply(self, messages: list[BaseMessage]) -> AIMessage:
            usage: Any = {"input_tokens": 9, "output_tokens": 1, "total_tokens": 10}
            return super()._reply(messages).model_copy(update={"usage_metadata": usage})

    managed = {"extra_body": {"context_management": [{"type": "compaction", "compact_threshold": 10**6}]}}
    fitted = FittedModel(Counting(sent=[], tools=[], pages=0), sp.ContextManager(120, record=tmp_path))
    for settings, question in ((managed, "Well?"), ({}, "So?")):
        bound = fitted.bind(**settings) if name == "bind" else fitted.bind_tools([read], **settings)
        bound.invoke(question)
    prompts = [prompt for path in tmp_path.iterdir() for prompt in read_thread(path).prompts]
    assert {(prompt.managed, prompt.reported) for prompt in prompts} == {(True, None), (False, 9)}
