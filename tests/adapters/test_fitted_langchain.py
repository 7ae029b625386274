"""Agents of LangChain and LangGraph that play no game, held to a budget by the context manager."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import pytest
from langchain.agents import create_agent
from langchain.agents.middleware import AgentMiddleware, ModelRequest
from langchain_core.language_models import BaseChatModel
from langchain_core.messages import AIMessage, AIMessageChunk, BaseMessage, HumanMessage, SystemMessage, ToolMessage
from langchain_core.outputs import ChatGeneration, ChatGenerationChunk, ChatResult
from langchain_core.prompt_values import ChatPromptValue
from langchain_core.tools import tool
from langgraph.checkpoint.memory import InMemorySaver
from pydantic import BaseModel
from smartplay_langchain import ContextManagerMiddleware, FittedModel

import smartplay_tools as sp
from smartplay_tools.context.tokens import TokenCounter
from tests.adapters.book import CAP, PAGES, SYSTEM, TASK, pages_of
from tests.adapters.fitted_fuzz import check_some
from tests.manager.histories import text_of_page

ASK = {"messages": [{"role": "user", "content": TASK}]}


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


def tokens(messages: Sequence[BaseMessage], tools: Sequence[Any] = (read,)) -> int:
    """A prompt's tokens by the counter for games, from messages converted by LangChain."""
    from langchain_core.messages import convert_to_openai_messages

    specs = [sp.ToolSpec(each.name, each.description, each.args_schema.model_json_schema()) for each in tools]
    return TokenCounter().prompt(convert_to_openai_messages(list(messages)), specs)


def is_whole(messages: Sequence[BaseMessage]) -> bool:
    """Whether every result follows the reply with its call, and every call has one."""
    waiting: list[str] = []
    for message in messages:
        if isinstance(message, ToolMessage):
            if message.tool_call_id not in waiting:
                return False
            waiting.remove(message.tool_call_id)
        elif waiting:
            return False
        elif isinstance(message, AIMessage):
            waiting = [str(call["id"]) for call in message.tool_calls]
    return not waiting


def check(model: Reader, *, stored: Sequence[BaseMessage]) -> None:
    """Every prompt is under its cap, whole and with its task, and the state has everything."""
    assert len(model.sent) == model.pages + 1
    for messages in model.sent:
        assert tokens(messages) <= CAP
        assert is_whole(messages)
        assert [message.content for message in messages[:2]] == [SYSTEM, "Read all pages."]
    assert len(model.sent[-1]) < len(stored)
    results = [message for message in stored if isinstance(message, ToolMessage)]
    assert [message.content for message in results] == [
        read.invoke({"page": int(message.tool_call_id[1:])}) for message in results
    ]
    given = {id(message) for message in stored}
    whole = [message for message in model.sent[-1][1:] if not str(message.content).endswith("tokens cut]")]
    assert all(id(message) in given for message in whole)


def agent(model: Reader, *, slack: float = 0.5, middlewares: Sequence[Any] = (), **options: Any) -> Any:
    middleware = ContextManagerMiddleware(sp.ContextManager(CAP, slack=slack))
    return create_agent(model, [read], system_prompt=SYSTEM, middleware=[middleware, *middlewares], **options)


@pytest.mark.parametrize("slack", [0, 0.5])
def test_an_agent_stays_under_its_cap(slack: float):
    model = Reader(sent=[], tools=[])
    state = agent(model, slack=slack).invoke(ASK, {"recursion_limit": 1_000})
    check(model, stored=state["messages"])


def test_an_agent_has_langchains_own_summaries_under_an_exact_cap():
    asked: list[int] = []

    def ask(messages: list[dict[str, Any]], max_tokens: int) -> str:
        asked.append(max_tokens)
        return "Pages were read."

    model = Reader(sent=[], tools=[])
    strategy = "langchain-summary:tokens=600,keep=4"
    manager = sp.ContextManager(CAP, strategy=strategy, question_tokens=4_000, ask=ask)
    middleware = ContextManagerMiddleware(manager)
    reader = create_agent(model, [read], system_prompt=SYSTEM, middleware=[middleware])
    state = reader.invoke(ASK, {"recursion_limit": 1_000})
    assert 0 < len(asked) < model.pages
    assert "Pages were read." in str(model.sent[-1])
    assert not any("Pages were read." in str(message.content) for message in state["messages"])
    for messages in model.sent:
        assert tokens(messages) <= CAP
        assert is_whole(messages)
        assert [message.content for message in messages[:2]] == [SYSTEM, "Read all pages."]


async def test_an_asynchronous_and_streamed_agent_stays_under_its_cap():
    model = Reader(sent=[], tools=[])
    pieces, state = 0, {}
    async for mode, piece in agent(model).astream(ASK, {"recursion_limit": 1_000}, stream_mode=["messages", "values"]):
        pieces += mode == "messages"
        state = piece if mode == "values" else state
    assert pieces > model.pages
    check(model, stored=state["messages"])


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
    agent(model, middlewares=[Reminds()]).invoke(ASK, {"recursion_limit": 1_000})
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
    check(model, stored=messages)


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


@pytest.mark.parametrize("is_asynchronous", [True, False])
async def test_a_summary_is_shown_as_words_of_the_user(is_asynchronous: bool):
    async def ask(messages: Any, max_tokens: int) -> str:
        return "Nothing but doors."

    def ask_at_once(messages: Any, max_tokens: int) -> str:
        return "Nothing but doors."

    model = Reader(sent=[], tools=[])
    options = {"strategy": sp.Summaries(60), "ask": ask if is_asynchronous else ask_at_once}
    middleware = ContextManagerMiddleware(sp.ContextManager(CAP, **options))
    reader = create_agent(model, [read], system_prompt=SYSTEM, middleware=[middleware])
    config: Any = {"recursion_limit": 1_000}
    state = await reader.ainvoke(ASK, config) if is_asynchronous else reader.invoke(ASK, config)
    check(model, stored=[*state["messages"], model.sent[-1][2]])
    assert isinstance(model.sent[-1][2], HumanMessage)
    assert str(model.sent[-1][2].content).endswith("Nothing but doors.")
    assert not any("Nothing but doors." in str(message.content) for message in state["messages"])


async def test_prompts_of_random_conversations_have_no_fault():
    await check_some("langchain")


def test_sub_agents_have_managers_of_their_own():
    inner, outer, stored = Reader(sent=[], tools=[]), Reader(sent=[], tools=[], pages=1), list[BaseMessage]()

    @tool("read")
    def ask(page: int) -> str:
        """Have a page read."""
        stored.extend(agent(inner).invoke(ASK, {"recursion_limit": 1_000})["messages"])
        return str(stored[-1].content)

    middleware = ContextManagerMiddleware(sp.ContextManager(300))
    state = create_agent(outer, [ask], middleware=[middleware]).invoke(ASK)
    assert [message.content for message in state["messages"][1:]] == ["Next.", "Done.", "Done."]
    check(inner, stored=stored)
