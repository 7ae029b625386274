"""Agents of Inspect that play no game, held to a budget by the context manager."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("inspect_ai", reason="needs smartplay-tools[inspect]; `.ci/run` has an environment with it")

from inspect_ai import Task, eval  # noqa: A004
from inspect_ai.agent import as_tool, react
from inspect_ai.dataset import Sample
from inspect_ai.model import (
    ChatMessage,
    ChatMessageAssistant,
    ChatMessageTool,
    ChatMessageUser,
    ContentImage,
    ContentReasoning,
    ContentText,
    GenerateConfig,
    Model,
    ModelOutput,
    ModelUsage,
    ResponseSchema,
    StreamTextEvent,
    get_model,
)
from inspect_ai.tool import Tool, ToolCall, ToolCallError, ToolInfo, tool
from inspect_ai.util import json_schema
from pydantic import BaseModel
from smartplay_inspect import WindowModel, fitted_model

import smartplay_tools as sp
from smartplay_tools.context.tokens import TokenCounter
from tests.adapters.book import CAP, PAGES, SYSTEM, TASK, pages_of
from tests.adapters.fitted_fuzz import check_some
from tests.manager.fuzz import cleared
from tests.manager.histories import text_of_page

PICTURE = (
    "data:image/png;base64,iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAQAAAC1HAwCAAAAC0lEQVR42mNk+A8AAQUBAScY42YAAAAASUVORK5CYII="
)


@tool
def read() -> Tool:
    async def execute(page: int) -> str:
        """Read a page.

        Args:
            page: Its number.
        """
        return text_of_page(page)

    return execute


class Reader:
    """Reads page after page, several at once now and then, and keeps what it is sent."""

    def __init__(self, pages: int = PAGES) -> None:
        self.pages = pages
        self.sent: list[list[ChatMessage]] = []
        self.tools: list[list[ToolInfo]] = []

    def __call__(self, messages: list[ChatMessage], tools: list[ToolInfo], *_: Any) -> ModelOutput:
        self.sent.append(messages)
        self.tools.append(tools)
        turn = len(self.sent)
        pages = pages_of(turn)
        calls = [ToolCall(id=f"c{page}", function="read", arguments={"page": page}) for page in pages]
        if turn > self.pages:
            calls = [ToolCall(id="end", function="submit", arguments={"answer": "Done."})]
        output = ModelOutput.from_content("mockllm/model", "Next.")
        output.choices[0].message = ChatMessageAssistant(content="Next.", tool_calls=calls)
        output.usage = ModelUsage(input_tokens=5, output_tokens=5, total_tokens=10)
        return output

    def model(self, **options: Any) -> Model:
        return get_model(
            "window/mockllm/model", custom_outputs=self, memoize=False, **{"prompt_tokens": CAP, **options}
        )


def tokens(messages: list[ChatMessage], tools: list[ToolInfo]) -> int:
    """A prompt's tokens by the counter for games, from messages that are converted here."""
    chat: list[dict[str, Any]] = []
    for message in messages:
        chat.append({"role": message.role, "content": message.text})
        if isinstance(message, ChatMessageAssistant) and message.tool_calls:
            sent = [{"name": c.function, "arguments": json.dumps(c.arguments)} for c in message.tool_calls]
            chat[-1]["tool_calls"] = [{"function": function} for function in sent]
    specs = [sp.ToolSpec(t.name, t.description, t.parameters.model_dump(exclude_none=True)) for t in tools]
    return TokenCounter().prompt(chat, specs)


def is_whole(messages: list[ChatMessage]) -> bool:
    """Whether every result follows the reply with its call, and every call has one."""
    waiting: list[str] = []
    for message in messages:
        if isinstance(message, ChatMessageTool):
            if message.tool_call_id not in waiting:
                return False
            waiting.remove(message.tool_call_id)
        elif waiting:
            return False
        elif isinstance(message, ChatMessageAssistant):
            waiting = [call.id for call in message.tool_calls or ()]
    return not waiting


def check(reader: Reader, stored: list[ChatMessage]) -> None:
    """Every prompt is under its cap, whole and with its task, and the sample's state has everything."""
    assert len(reader.sent) == reader.pages + 1
    for messages, tools in zip(reader.sent, reader.tools, strict=True):
        assert tokens(messages, tools) <= CAP
        assert is_whole(messages)
        assert TASK in [message.text for message in messages[:2]]
    assert len(reader.sent[-1]) < len(stored)
    results = [message for message in stored if isinstance(message, ChatMessageTool) and message.function == "read"]
    assert [message.text for message in results] == [text_of_page(int(str(m.tool_call_id)[1:])) for m in results]
    given = {message.id for message in stored}
    assert all(message.id in given for message in reader.sent[-1] if isinstance(message, ChatMessageAssistant))


def played(model: Model, folder: Path, tools: Any = ()) -> Any:
    agent = react(prompt=SYSTEM, tools=[*(tools or [read()])])
    task = Task([Sample(TASK)], solver=agent)
    (log,) = eval(task, model=model, log_dir=str(folder), display="none", score=False)
    assert log.status == "success", log.error
    assert log.samples is not None
    return log.samples[0]


@pytest.mark.parametrize("slack", [0, 0.5])
def test_an_agent_stays_under_its_cap(tmp_path: Path, slack: float):
    reader = Reader()
    sample = played(reader.model(slack=slack), tmp_path)
    check(reader, sample.messages)


def test_a_manager_of_ones_own_shows_summaries_that_are_not_stored(tmp_path: Path):
    async def ask(messages: Any, max_tokens: int) -> str:
        return "Nothing but doors."

    reader = Reader()
    inner = get_model("mockllm/model", custom_outputs=reader)
    manager = sp.ContextManager(CAP, strategy=sp.Summaries(60), ask=ask, record=tmp_path / "record")
    sample = played(fitted_model(inner, manager), tmp_path)
    check(reader, sample.messages)
    assert "Nothing but doors." in reader.sent[-1][2].text
    assert "Nothing but doors." not in str(sample.messages)
    assert '"kind": "usage"' in next((tmp_path / "record").iterdir()).read_text()


def test_a_compactor_rewrites_what_is_sent_alone(tmp_path: Path):
    reader = Reader()
    inner = get_model("mockllm/model", custom_outputs=reader)
    sample = played(fitted_model(inner, sp.ContextManager(CAP, strategy=cleared)), tmp_path)
    for messages, tools in zip(reader.sent, reader.tools, strict=True):
        assert tokens(messages, tools) <= CAP
        assert is_whole(messages)
    assert {"[cleared]", "shorter"} <= {message.text for message in reader.sent[-1]}
    assert not {"[cleared]", "shorter"} & {message.text for message in sample.messages}


def test_sub_agents_have_models_of_their_own(tmp_path: Path):
    inner, outer = Reader(), Reader(1)
    sub = react(name="read", description="Reads.", prompt=SYSTEM, tools=[read()], model=inner.model())

    def ask(messages: list[ChatMessage], tools: list[ToolInfo], *rest: Any) -> ModelOutput:
        output = outer(messages, tools, *rest)
        for call in output.message.tool_calls or ():
            call.arguments = {"input": TASK} if call.function == "read" else call.arguments
        return output

    model = get_model("window/mockllm/model", custom_outputs=ask, memoize=False, prompt_tokens=400)
    played(model, tmp_path, [as_tool(sub)])
    assert len(inner.sent) == PAGES + 1
    assert all(tokens(*each) <= CAP and is_whole(each[0]) for each in zip(inner.sent, inner.tools, strict=True))


async def test_tools_and_the_output_schema_count():
    class Answer(BaseModel):
        words: str

    reader = Reader(0)
    model = reader.model(prompt_tokens=60)
    schema = ResponseSchema(name="answer", json_schema=json_schema(Answer))
    with pytest.raises(sp.PromptOverflowError, match=r"tools \d"):
        await model.generate(TASK, tools=[read()], config=GenerateConfig(response_schema=schema))
    await model.generate(TASK, tools=[read()])


async def test_thoughts_pictures_and_errors_count_as_they_are_sent():
    picture = ContentImage(image=PICTURE)
    call = ToolCall(id="c1", function="read", arguments={"page": 1})
    reply = ChatMessageAssistant(
        content=[ContentReasoning(reasoning="hm " * 50), ContentText(text="Yes.")], tool_calls=[call]
    )
    error = ToolCallError("unknown", "fault " * 600)
    result = ChatMessageTool(content="", tool_call_id="c1", function="read", error=error)
    messages: list[ChatMessage] = [ChatMessageUser(content=[ContentText(text=TASK), picture]), reply, result]
    reader = Reader(0)
    with pytest.raises(sp.InvalidArgumentError, match=r"^Message 0 has a picture"):
        await reader.model().generate(messages)
    await reader.model(picture_tokens=100).generate(messages)
    (sent,) = reader.sent
    assert sent[:2] == messages[:2]
    assert sent[2].text.startswith("Error: fault")
    assert sent[2].text.endswith("tokens cut]")
    with pytest.raises(sp.PromptOverflowError):
        await reader.model(picture_tokens=100, prompt_tokens=150).generate(messages)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"prompt_tokens": CAP, "pin": print}, "fitted_model"),
        ({}, "needs prompt_tokens"),
        ({"prompt_tokens": 0}, "from 1"),
    ],
)
def test_options_that_cannot_be_told_apart_are_refused(options: dict[str, Any], sentence: str):
    with pytest.raises(sp.InvalidArgumentError, match=sentence):
        get_model("window/mockllm/model", memoize=False, **options)


def test_everything_else_is_the_models(tmp_path: Path):
    model = Reader().model()
    assert isinstance(model.api, WindowModel)
    assert (str(model), model.canonical_name()) == ("window/mockllm/model", "model")
    assert model.api.connection_key() == model.api.api.connection_key()
    assert model.api.outputs is model.api.api.outputs


async def test_prompts_of_random_conversations_have_no_fault():
    await check_some("inspect")


async def test_a_reply_is_streamed_as_the_model_streams_it():
    from inspect_ai.model._stream import report_model_stream_delta, report_model_stream_start

    async def answer(messages: list[ChatMessage], *_: Any) -> ModelOutput:
        report_model_stream_start()
        await report_model_stream_delta(StreamTextEvent(text=f"{len(messages)} messages."))
        output = ModelOutput.from_content("mockllm/model", "Done.")
        output.usage = ModelUsage(input_tokens=1, output_tokens=1, total_tokens=2)
        return output

    pieces: list[Any] = []

    async def keep(event: Any) -> None:
        pieces.append(event)

    given = [ChatMessageUser(content="Well? " * 400) for _ in range(4)]
    model = get_model("window/mockllm/model", custom_outputs=answer, memoize=False, prompt_tokens=CAP, head="system")
    await model.generate([*given, ChatMessageUser(content="So?")], on_stream=keep)
    assert [piece.text for piece in pieces] == ["2 messages."]


async def test_messages_that_come_to_stand_together_are_joined_where_the_provider_wants_it(monkeypatch):
    """A pinned unit and the run may have words of one role on both sides of what is left out."""
    reader = Reader(0)
    model = reader.model(prompt_tokens=160, first_turns=1, slack=0)
    for role in ("user", "assistant", "system"):
        monkeypatch.setattr(type(model.api.api), f"collapse_{role}_messages", lambda _: True)
    reply = ChatMessageAssistant(content="First.")
    given = [ChatMessageUser(content=TASK), reply, *[ChatMessageUser(content="So? " * 200), reply] * 4]
    await model.generate([*given, ChatMessageUser(content="Well?")])
    (sent,) = reader.sent
    assert [message.role for message in sent] == ["user", "assistant", "user"]
    assert [part.text for part in sent[1].content] == ["First.", "First."]
