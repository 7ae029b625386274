"""What the window endpoint reads from a request of a host's agent: call ids, results, tools and other facts.

Messages are not checked, because they have no power over the window: a request with a picture, with items of a kind
that is new, or with a history that a provider would refuse is as good as any other.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from smartplay_tools import ToolSpec
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
    forbids_calls: bool = False
    """Whether the reply has to be words, as for a summary of the agent's own."""
    answer_schema: Mapping[str, Any] | None = None
    """The JSON Schema that the text of an answer has to have."""
    continues: bool = False
    """Whether it has only new messages, and the tools are those of the previous request."""
    is_of_sub_agent: bool = False
    messages: Sequence[Any] = ()
    """The host's own messages; none where it sends only what is new."""

    def holds(self, call_id: str) -> bool:
        """Whether the request mentions a call."""
        return call_id in self.body


def objects(values: Any) -> Iterable[Mapping[str, Any]]:
    """Return the objects in a list; nothing if it is not one."""
    return [value for value in values if isinstance(value, Mapping)] if isinstance(values, list) else []


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
