"""Agents of Inspect that play no game, held to a budget by the context manager."""

from __future__ import annotations

from typing import Any

import pytest

pytest.importorskip("inspect_ai", reason="needs smartplay-tools[inspect]; `.ci/run` has an environment with it")

from inspect_ai import Task, eval_async
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
from smartplay_inspect import fitted_model
from smartplay_inspect.messages import tool_specs

import smartplay_tools as sp
from tests.adapters.book import CAP, PAGES, SYSTEM, TASK, pages_of
from tests.adapters.fitted import Book, FittedConformance
from tests.manager.histories import text_of_page

# Inspect and what it imports warn; what they warn of is theirs.
pytestmark = pytest.mark.filterwarnings("ignore")

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


class TestInspect(FittedConformance):
    framework, streams = "inspect", False

    async def read(self, manager: sp.ContextManager, *, streamed: bool = False) -> Book:
        reader = Reader()
        model = fitted_model(get_model("mockllm/model", custom_outputs=reader), manager)
        task = Task([Sample(TASK)], solver=react(prompt=SYSTEM, tools=[read()]))
        (log,) = await eval_async(task, model=model, log_dir="memory://logs", score=False)
        assert log.status == "success", log.error
        (sample,) = log.samples or ()
        return Book(reader.sent, sample.messages, tool_specs(reader.tools[0]))

    async def read_by_sub_agent(self, manager: sp.ContextManager, chief: sp.ContextManager) -> Book:
        inner, outer = Reader(), Reader(1)

        def ask(messages: list[ChatMessage], tools: list[ToolInfo], *rest: Any) -> ModelOutput:
            output = outer(messages, tools, *rest)
            for call in output.message.tool_calls or ():
                call.arguments = {"input": TASK} if call.function == "read" else call.arguments
            return output

        own = fitted_model(get_model("mockllm/model", custom_outputs=inner, memoize=False), manager)
        reader = react(name="read", description="Reads.", prompt=SYSTEM, tools=[read()], model=own)
        model = fitted_model(get_model("mockllm/model", custom_outputs=ask, memoize=False), chief)
        task = Task([Sample(TASK)], solver=react(prompt=SYSTEM, tools=[as_tool(reader)]))
        (log,) = await eval_async(task, model=model, log_dir="memory://logs", score=False)
        assert log.status == "success", log.error
        return Book(inner.sent, [], tool_specs(inner.tools[0]))


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
    assert sent[1].text == "First.\nFirst."
