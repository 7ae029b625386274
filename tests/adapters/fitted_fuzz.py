"""Has the adapters of four frameworks fit random conversations, and judges what their models are sent.

    python -m tests.adapters.fitted_fuzz langchain --prompts 25000 --seed 1

The others are `agents`, `inspect` and `pydantic-ai`. A conversation grows in the framework's own messages, and each of
its prompts goes through the adapter, synchronously, asynchronously or streamed, some of them again by a new manager.
What the model is sent is read by code of this module, and counted, paired and compared by that of the judges.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import random
from collections import Counter
from collections.abc import AsyncIterator, Iterator
from itertools import pairwise
from typing import Any, Protocol

import smartplay_tools as sp
from smartplay_tools.errors import PromptOverflowError
from tests.counting import tools_tokens
from tests.manager.fuzz import CAPS, ask, settings
from tests.manager.histories import KINDS, Messages, chat, responses
from tests.manager.judge import Letters, is_broken, keeps_task, n, total

NAME, ABOUT = "read", "Read a page."
SCHEMA: dict[str, Any] = {
    "type": "object",
    "properties": {"page": {"type": "integer", "description": "The number of the page."}},
    "required": ["page"],
}
FUNCTION = {"name": NAME, "description": ABOUT, "parameters": SCHEMA}
"""The tool of every request."""


class Host(Protocol):
    """A framework with an adapter."""

    form: str
    """The form in which prompts are judged."""

    def stored(self, conversation: Messages) -> list[Any]:
        """A conversation in the messages that the framework keeps."""

    def read(self, sent: list[Any]) -> Messages:
        """What the model was sent, in the form of the judge."""

    async def send(self, manager: sp.ContextManager, stored: list[Any], way: int) -> list[Any]:
        """Send a conversation through the adapter, in one of several ways; return what the model was sent."""


def said(reasoning: str, text: str) -> Messages:
    """The parts of a reply that thinks."""
    thought = [{"type": "thinking", "thinking": reasoning, "signature": ""}] if reasoning else []
    return [*thought, {"type": "text", "text": text}]


def replied(text: str, calls: list[tuple[str, str, str]], thoughts: str = "") -> dict[str, Any]:
    """A reply for the judge; calls are ids, names and arguments."""
    made = [{"id": i, "function": {"name": name, "arguments": arguments}} for i, name, arguments in calls]
    return {
        "role": "assistant",
        "content": text,
        **({"tool_calls": made} if made else {}),
        **({"reasoning_content": thoughts} if thoughts else {}),
    }


class LangChain:
    """A middleware of LangChain's, between a request and a chat model."""

    form = "chat"

    def __init__(self) -> None:
        from langchain_core.language_models import BaseChatModel
        from langchain_core.messages import AIMessage, AIMessageChunk
        from langchain_core.outputs import ChatGeneration, ChatGenerationChunk, ChatResult

        class Recorder(BaseChatModel):
            """Keeps what it is sent."""

            sent: list[Any]

            @property
            def _llm_type(self) -> str:
                return "recorder"

            def bind_tools(self, tools: Any, **options: Any) -> Any:
                assert tools == [{"type": "function", "function": FUNCTION}]
                return self.bind(**options)

            def _generate(self, messages: Any, *_: Any, **__: Any) -> ChatResult:
                self.sent.append(messages)
                return ChatResult(generations=[ChatGeneration(message=AIMessage("Done."))])

            def _stream(self, messages: Any, *_: Any, **__: Any) -> Iterator[ChatGenerationChunk]:
                self.sent.append(messages)
                yield ChatGenerationChunk(message=AIMessageChunk("Done.", chunk_position="last"))

        self._sent: list[Any] = []
        self._model = Recorder(sent=[])
        self._model.sent = self._sent

    def stored(self, conversation: Messages) -> list[Any]:
        from langchain_core.messages import AIMessage, HumanMessage, SystemMessage, ToolMessage

        made: list[Any] = []
        for message in conversation:
            match message["role"]:
                case "assistant":
                    content: Any = said(message.get("reasoning_content", ""), message["content"])
                    calls = [
                        {"name": c["function"]["name"], "args": json.loads(c["function"]["arguments"]), "id": c["id"]}
                        for c in message.get("tool_calls", ())
                    ]
                    made.append(AIMessage(content if content[1:] else message["content"], tool_calls=calls))
                case "tool":
                    made.append(ToolMessage(message["content"], tool_call_id=message["tool_call_id"]))
                case role:
                    made.append({"system": SystemMessage, "user": HumanMessage}[role](message["content"]))
        return made

    def read(self, sent: list[Any]) -> Messages:
        made: Messages = []
        for message in sent:
            blocks = [{"text": message.content}] if isinstance(message.content, str) else message.content
            text = "".join(block.get("text", "") for block in blocks)
            if message.type == "ai":
                calls = [(c["id"], c["name"], json.dumps(c["args"], ensure_ascii=False)) for c in message.tool_calls]
                made.append(replied(text, calls, "".join(block.get("thinking", "") for block in blocks)))
            elif message.type == "tool":
                made.append({"role": "tool", "content": text, "tool_call_id": message.tool_call_id})
            else:
                made.append({"role": {"system": "system", "human": "user"}[message.type], "content": text})
        return made

    async def send(self, manager: sp.ContextManager, stored: list[Any], way: int) -> list[Any]:
        from langchain.agents.middleware import ModelRequest, ModelResponse
        from smartplay_langchain import ContextManagerMiddleware

        def bound(request: ModelRequest[Any]) -> Any:
            return request.model.bind_tools(request.tools)

        def handler(request: ModelRequest[Any]) -> ModelResponse[Any]:
            if way == 0:
                return ModelResponse([bound(request).invoke(request.messages)])
            return ModelResponse([*bound(request).stream(request.messages)])

        async def ahandler(request: ModelRequest[Any]) -> ModelResponse[Any]:
            if way == 1:
                return ModelResponse([await bound(request).ainvoke(request.messages)])
            return ModelResponse([piece async for piece in bound(request).astream(request.messages)])

        tools: Any = [{"type": "function", "function": FUNCTION}]
        request: ModelRequest[Any] = ModelRequest(model=self._model, messages=stored, tools=tools)
        middleware = ContextManagerMiddleware(manager)
        if way in (0, 2):
            middleware.wrap_model_call(request, handler)
        else:
            await middleware.awrap_model_call(request, ahandler)
        return list(self._sent.pop())


class Agents:
    """A model of the Agents SDK's, around one that keeps its input."""

    form = "responses"

    def stored(self, conversation: Messages) -> list[Any]:
        return responses(conversation)

    def read(self, sent: list[Any]) -> Messages:
        return [{"type": "message", **item} for item in sent]

    async def send(self, manager: sp.ContextManager, stored: list[Any], way: int) -> list[Any]:
        from agents import FunctionTool, ModelSettings, ModelTracing
        from agents.testing import ScriptedModel, assistant_message
        from smartplay_openai.fitting import ContextManagerModel

        async def invoke(*_: Any) -> str:
            raise AssertionError("no call is played")

        recorder = ScriptedModel()
        recorder.enqueue([assistant_message("Done.")])
        model, tool = ContextManagerModel(recorder, manager), FunctionTool(NAME, ABOUT, SCHEMA, invoke)
        rest: Any = (ModelSettings(), [tool], None, [], ModelTracing.DISABLED)
        kept: Any = {"previous_response_id": None, "conversation_id": None, "prompt": None}
        if way < 2:
            await model.get_response(None, stored, *rest, **kept)
        else:
            async for _ in model.stream_response(None, stored, *rest, **kept):
                pass
        (call,) = recorder.calls
        return list(call.input)


class PydanticAI:
    """A model of Pydantic AI's, as the capability wraps it."""

    form = "chat"

    def stored(self, conversation: Messages) -> list[Any]:
        from pydantic_ai.messages import (
            ModelRequest,
            ModelResponse,
            SystemPromptPart,
            TextPart,
            ThinkingPart,
            ToolCallPart,
            ToolReturnPart,
            UserPromptPart,
        )

        made: list[Any] = []
        for message in conversation:
            if message["role"] == "assistant":
                thoughts = [ThinkingPart(message["reasoning_content"])] if "reasoning_content" in message else []
                calls = [
                    ToolCallPart(c["function"]["name"], c["function"]["arguments"], c["id"])
                    for c in message.get("tool_calls", ())
                ]
                made.append(ModelResponse([*thoughts, TextPart(message["content"]), *calls]))
                continue
            if message["role"] == "tool":
                part: Any = ToolReturnPart("act", message["content"], message["tool_call_id"])
            else:
                part = {"system": SystemPromptPart, "user": UserPromptPart}[message["role"]](message["content"])
            if made and isinstance(made[-1], ModelRequest):
                made[-1] = ModelRequest([*made[-1].parts, part])
            else:
                made.append(ModelRequest([part]))
        return made

    def read(self, sent: list[Any]) -> Messages:
        made: Messages = []
        for message in sent:
            parts = [(part.part_kind, part) for part in message.parts]
            if message.kind == "response":
                calls = [
                    (p.tool_call_id, p.tool_name, p.args_as_json_str()) for kind, p in parts if kind == "tool-call"
                ]
                text, thoughts = (
                    "".join(p.content for kind, p in parts if kind == wanted) for wanted in ("text", "thinking")
                )
                made.append(replied(text, calls, thoughts))
                continue
            for kind, part in parts:
                role = {"system-prompt": "system", "user-prompt": "user", "tool-return": "tool"}[kind]
                made.append({"role": role, "content": part.content})
                if role == "tool":
                    made[-1]["tool_call_id"] = part.tool_call_id
        return made

    async def send(self, manager: sp.ContextManager, stored: list[Any], way: int) -> list[Any]:
        from pydantic_ai.messages import ModelResponse, TextPart
        from pydantic_ai.models import ModelRequestParameters
        from pydantic_ai.models.function import FunctionModel
        from pydantic_ai.tools import ToolDefinition
        from smartplay_pydantic_ai import ContextManagerCapability

        sent: list[Any] = []

        def answer(messages: Any, _: Any) -> ModelResponse:
            sent.extend(messages)
            return ModelResponse([TextPart("Done.")])

        async def stream(messages: Any, _: Any) -> AsyncIterator[str]:
            sent.extend(messages)
            yield "Done."

        tool = ToolDefinition(name=NAME, description=ABOUT, parameters_json_schema=SCHEMA)
        model = ContextManagerCapability(manager).get_wrapper_model(FunctionModel(answer, stream_function=stream))
        request: Any = (stored, None, ModelRequestParameters(function_tools=[tool]))
        if way < 2:
            await model.request(*request)
        else:
            async with model.request_stream(*request) as response:
                _ = [event async for event in response]
        return sent


class Inspect:
    """A model of Inspect's, around its mock."""

    form = "chat"

    def stored(self, conversation: Messages) -> list[Any]:
        from inspect_ai.model import (
            ChatMessageAssistant,
            ChatMessageSystem,
            ChatMessageTool,
            ChatMessageUser,
            ContentReasoning,
            ContentText,
        )
        from inspect_ai.tool import ToolCall

        made: list[Any] = []
        for message in conversation:
            match message["role"]:
                case "assistant":
                    content: Any = message["content"]
                    if "reasoning_content" in message:
                        content = [ContentReasoning(reasoning=message["reasoning_content"]), ContentText(text=content)]
                    calls = [
                        ToolCall(c["id"], c["function"]["name"], json.loads(c["function"]["arguments"]))
                        for c in message.get("tool_calls", ())
                    ]
                    made.append(ChatMessageAssistant(content=content, tool_calls=calls or None))
                case "tool":
                    made.append(ChatMessageTool(content=message["content"], tool_call_id=message["tool_call_id"]))
                case role:
                    kind: Any = {"system": ChatMessageSystem, "user": ChatMessageUser}[role]
                    made.append(kind(content=message["content"]))
        return made

    def read(self, sent: list[Any]) -> Messages:
        made: Messages = []
        for message in sent:
            if message.role == "assistant":
                calls = [
                    (c.id, c.function, json.dumps(c.arguments, ensure_ascii=False)) for c in message.tool_calls or ()
                ]
                parts = () if isinstance(message.content, str) else message.content
                thoughts = "".join(part.reasoning for part in parts if part.type == "reasoning")
                made.append(replied(message.text, calls, thoughts))
                continue
            made.append({"role": message.role, "content": message.text})
            if message.role == "tool":
                made[-1]["tool_call_id"] = message.tool_call_id
        return made

    async def send(self, manager: sp.ContextManager, stored: list[Any], way: int) -> list[Any]:
        from inspect_ai.model import ModelOutput, ModelUsage, get_model
        from inspect_ai.tool import ToolInfo, ToolParams
        from smartplay_inspect import fitted_model

        sent: list[Any] = []

        def answer(messages: Any, *_: Any) -> ModelOutput:
            sent.extend(messages)
            output = ModelOutput.from_content("mockllm/model", "Done.")
            output.usage = ModelUsage(input_tokens=1, output_tokens=1, total_tokens=2)  # it would count by itself
            return output

        model = fitted_model(get_model("mockllm/model", custom_outputs=answer, memoize=False), manager)
        tool = ToolInfo(name=NAME, description=ABOUT, parameters=ToolParams.model_validate(SCHEMA))
        await model.generate(stored, tools=[tool])
        return sent


HOSTS: dict[str, tuple[type[Host], int]] = {
    "langchain": (LangChain, 4),
    "agents": (Agents, 3),
    "inspect": (Inspect, 2),
    "pydantic-ai": (PydanticAI, 3),
}
"""The frameworks, and in how many ways a request is made: sync or async, and streamed."""


def stretches(conversation: Messages) -> list[Messages]:
    """What is new at each request of an agent: it is made before a reply, and at the end."""
    roles = [message["role"] for message in conversation]
    starts = [at for at in range(2, len(roles)) if roles[at] == "assistant" != roles[at - 1]]
    return [conversation[first:stop] for first, stop in pairwise([0, *starts, len(roles)])]


async def judged(host: Host, ways: int, number: int, seed: int) -> Counter[str]:
    """Counts of one conversation as it grows, each of whose prompts one manager makes."""
    rng, row = random.Random(f"{seed}:{number}"), Counter[str](conversations=1)
    cap, options = rng.choice(CAPS), settings(rng)

    def manager() -> sp.ContextManager:
        asked: dict[str, Any] = {"ask": ask, "memo": {}} if options["strategy"] else {}
        return sp.ContextManager(cap, tokenizer=Letters(), **options, **asked)

    async def sent_by(manager: sp.ContextManager, way: int) -> Messages | None:
        try:
            return host.read(await host.send(manager, stored, way))
        except PromptOverflowError:
            return None

    tools, used = tools_tokens([FUNCTION], n), manager()
    stored, before, whole = list[Any](), list[str](), list[dict[str, Any]]()
    for stretch in stretches(chat(rng, KINDS[number % 5])):
        new = host.stored(stretch)
        stored, before, whole = [*stored, *new], [*before, *map(repr, new)], [*whole, *host.read(new)]
        objects, way = [*map(id, stored)], rng.randrange(ways)
        shown = await sent_by(used, way)
        row["prompts"] += 1
        if rng.random() < 0.05:
            row["asked again"] += 1
            again = await sent_by(manager(), (way + 1) % ways)
            row["fault: another prompt when asked again"] += shown != again
        row["fault: what the framework keeps is changed"] += [*map(id, stored)] != objects
        if shown is None:
            row[f"refused at {cap}"] += 1
            continue
        row["of fewer messages"] += len(shown) < len(whole)
        row["fault: over the cap"] += total(host.form, shown) + tools > cap
        row["fault: calls apart from results"] += is_broken(host.form, shown)
        row["fault: the task or the newest words lost"] += not keeps_task(host.form, whole, shown, options["head"])
    row["fault: what the framework keeps is changed"] += [*map(repr, stored)] != before
    return row


async def some(name: str, prompts: int, seed: int) -> Counter[str]:
    """Counts of at least so many prompts."""
    kind, ways = HOSTS[name]
    host, rows, number = kind(), Counter[str](), 0
    while rows["prompts"] < prompts:
        row = await judged(host, ways, number, seed)
        rows.update(row)
        if faults(row):
            print(f"{seed}:{number}: {', '.join(name for name in row if row[name])}")
        number += 1
    return rows


async def check_some(name: str) -> None:
    """Check that four hundred prompts of a framework have no fault, and that many of them are cut."""
    rows = await some(name, 400, seed=6)
    assert not faults(rows), rows
    assert rows["of fewer messages"] > 150
    assert rows["asked again"] > 10


def faults(rows: Counter[str]) -> int:
    """How many faults there are."""
    return sum(count for name, count in rows.items() if name.startswith("fault"))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("framework", choices=HOSTS)
    parser.add_argument("--prompts", type=int, default=1_000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    rows = asyncio.run(some(options.framework, options.prompts, options.seed))
    for name, count in sorted(rows.items()):
        print(f"{name:48}{count:>10,}")
    raise SystemExit(bool(faults(rows)))


if __name__ == "__main__":
    main()
