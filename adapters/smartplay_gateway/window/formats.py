"""The interfaces at which hosts ask the window endpoint: how each reads a request and writes an answer.

OpenAI's two write as the local endpoint does, and read less strictly. Each has its own ids of calls and form of errors.
Of a request only call ids, results, tools and a few other facts are read (`CompletionRequest`). Messages are not
checked, because they have no power over the window: a request with a picture, with items of a kind that is new, or with
a history that a provider would refuse is as good as any other.
"""

from __future__ import annotations

import json
from abc import abstractmethod
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

from smartplay_tools import Message, ToolSpec, Usage
from smartplay_tools.players.wire import CHAT, Event, Streaming, bad, objects, read_tools
from smartplay_tools.types.messages import words_of


@dataclass
class Ignored:
    """The parts of a request's messages and fields that do not reach the model."""

    characters: Counter[str] = field(default_factory=Counter)
    """The characters of ignored messages, by role."""
    kinds: Counter[str] = field(default_factory=Counter)
    """Parts and items that have no text, by their type."""
    fields: Sequence[str] = ()

    def hear(self, role: str, content: Any) -> str:
        """Count a message, and return its text."""
        text, kinds = words_of(content)
        self.characters[role] += len(text)
        self.kinds.update(kinds)
        return text


@dataclass(frozen=True)
class CompletionRequest:
    """What a request says.

    `results` are the tool results in it by call id, as they were sent, `body` its text, in which call ids are looked
    for wherever a framework may have put them: smolagents, for example, writes calls and results into the text of
    messages.
    """

    tools: Sequence[ToolSpec]
    results: Mapping[str, Any]
    body: str
    ignored: Ignored = field(default_factory=Ignored)
    system: str = ""
    """The host's instructions."""
    left_out: Sequence[str] = ()
    """Tools that no host runs or that take no JSON, which the model is not shown."""
    calls: Mapping[str, tuple[str, Any]] = field(default_factory=dict)
    """The calls in the host's own messages: name and arguments by call id."""
    one_call: bool = False
    """Whether the host takes one call at a time."""
    forbids_calls: bool = False
    """Whether the reply has to be words, as for a summary of the agent's own."""
    answer_schema: Mapping[str, Any] | None = None
    """The JSON Schema that the text of an answer has to have."""
    continues: bool = False
    """Whether it has only new messages, and the tools are those of the previous request."""
    is_of_sub_agent: bool = False
    """Whether its headers say so."""
    messages: Sequence[Any] = ()
    """The host's own messages; none where it sends only what is new."""

    def holds(self, call_id: str) -> bool:
        """Whether the request mentions a call."""
        return call_id in self.body


def known_by(message: Any) -> tuple[Any, str]:
    """Return what tells a host's message or item from others, and its text. Marks for the cache come and go."""
    if not isinstance(message, Mapping):
        return repr(message), ""
    content = message.get("content", message.get("output", message.get("arguments")))
    blocks = [*objects(content), *objects(message.get("tool_calls"))]
    ids = [block.get("id", block.get("tool_use_id")) for block in blocks]
    inner = [block["content"] for block in blocks if block.get("type") == "tool_result" and "content" in block]
    text = "".join(words_of(part)[0] for part in (inner or [content]))
    return (message.get("type"), message.get("role"), message.get("call_id"), text, *ids), text


def json_schema(holder: Any) -> Mapping[str, Any] | None:
    """Return the schema in a `response_format`, a `text.format` or an `output_format` of the type `json_schema`."""
    if not isinstance(holder, Mapping) or holder.get("type") != "json_schema":
        return None
    inner = holder.get("json_schema")
    schema = (inner if isinstance(inner, Mapping) else holder).get("schema")
    return schema if isinstance(schema, Mapping) else {"type": "object"}


class HostFormat(Streaming):
    """An interface at which hosts ask for the model's reply."""

    path: ClassVar[str]

    @abstractmethod
    def read(self, body: Mapping[str, Any]) -> CompletionRequest:
        """Return what a request says; raise `RequestError` for tools that cannot be shown to the model."""

    @abstractmethod
    def write(self, message: Message, usage: Usage, body: Mapping[str, Any]) -> dict[str, Any]:
        """Return the answer to a request that says a message."""


class ChatFormat(HostFormat):
    """Chat completions."""

    path = CHAT.path

    def read(self, body: Mapping[str, Any]) -> CompletionRequest:
        """Return what a request says."""
        messages = messages_of(body, "messages")
        functions, left_out = functions_of(body)
        ignored = Ignored(fields=fields_of(body, {"messages", "tools", "stream_options", "parallel_tool_calls"}))
        results, system, calls = dict[str, Any](), list[str](), dict[str, tuple[str, Any]]()
        for message in objects(messages):
            role, content = str(message.get("role")), message.get("content")
            if role == "tool":
                results[str(message.get("tool_call_id"))] = content
            elif role != "assistant" or not message.get("tool_calls"):
                text = ignored.hear(role, content)
                system += [text] if role in ("system", "developer") else []
            for call in objects(message.get("tool_calls")):
                function = call.get("function")
                if isinstance(function, Mapping):
                    calls[str(call.get("id"))] = str(function.get("name")), function.get("arguments")
        return CompletionRequest(
            read_tools({"tools": functions}, "function", strict=False),
            results,
            json.dumps(body),
            ignored,
            "\n\n".join(system),
            left_out,
            calls,
            one_call=body.get("parallel_tool_calls") is False,
            forbids_calls=body.get("tool_choice") == "none",
            answer_schema=json_schema(body.get("response_format")),
            messages=messages,
        )

    def write(self, message: Message, usage: Usage, body: Mapping[str, Any]) -> dict[str, Any]:
        """Return the completion."""
        return CHAT.write(message, str(body["model"]), usage)

    def stream(self, answer: dict[str, Any], body: Mapping[str, Any]) -> Iterator[Event]:
        """Yield the completion's chunks."""
        return CHAT.stream(answer, body)


def messages_of(body: Mapping[str, Any], field: str) -> list[Any]:
    """Return a request's messages or items: a text is one of the user's, and a field that is not there is none."""
    messages = body.get(field)
    if isinstance(messages, str):
        return [{"role": "user", "content": messages}]
    if not isinstance(messages, list | None):
        raise bad(f"{field} is a text or a list.", field)
    return messages or []


def functions_of(body: Mapping[str, Any]) -> tuple[list[Any], list[str]]:
    """Return a request's functions, and what its other tools are: run by the provider, or called with free text."""
    tools = body.get("tools")
    if not isinstance(tools, list | None):
        raise bad("tools is a list.", "tools")
    functions, left_out = [], []
    for tool in tools or ():
        kind = tool.get("type") if isinstance(tool, Mapping) else None
        if isinstance(kind, str) and kind != "function":
            inner = tool.get(kind)
            name = tool.get("name") or (inner.get("name") if isinstance(inner, Mapping) else None)
            left_out.append(f"{name} ({kind})" if name else kind)
        else:
            functions.append(tool)
    return functions, left_out


FALSE_ANYWAY = {"background", "logprobs", "store"}
"""Fields that are as good as absent if they are false; of any other, false is a wish."""


def fields_of(body: Mapping[str, Any], used: set[str]) -> list[str]:
    """Return the names of a request's fields that have no effect."""
    said = {name for name, value in body.items() if value is not None}
    said -= {name for name in FALSE_ANYWAY if body.get(name) is False}
    return sorted(said - used - {"model", "stream"})


CHAT_FORMAT = ChatFormat()
