"""Prompts for models whose chat template knows no tools, and what the calls of every model are bound to.

Many small models were never shown a tool, and their template drops the schemas without a word. So the tools are part of
the system message, a call is one JSON object in the text of a reply, and a result is a user message. A model whose
template has tools is sent them there. While either model writes, llama.cpp allows only what continues to a call of one
of the tools: no call is malformed unless a cap on the reply cuts it.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from smartplay_local.engine import xllamacpp
from smartplay_tools import InvalidArgumentError, Message, ToolSpec
from smartplay_tools.types.arguments import object_in, value_in
from smartplay_tools.types.messages import calls_of, text_of

TOOLS = """Tools:
{tools}

Answer with one JSON object and nothing else: {{"name": TOOL, "arguments": {{...}}}}"""

LONGEST_TEXT = 2_000
"""Characters of a text in a call's arguments without its own limit: a model that repeats itself has to stop."""

LONGEST_ACTION = 64
"""The same of an action, which has a name of a few words or a number."""


def as_text(messages: Iterable[Message], tools: Sequence[ToolSpec]) -> list[Message]:
    """Return messages that any chat template can write: roles alternate, calls and results are text."""
    written: list[Message] = []
    for message in messages:
        role, text = _line(message)
        if written and written[-1]["role"] == role:
            written[-1] = {"role": role, "content": f"{text_of(written[-1])}\n\n{text}"}
        else:
            written.append({"role": role, "content": text})
    return [_with_tools(written[0], tools), *written[1:]] if tools and written else written


def sample(*, with_tools: bool) -> tuple[list[Message], list[dict[str, Any]]]:
    """Return a short chat in the form of prompts, and its tools, with which a chat template can be tried."""
    call: Any = {"id": "local0000", "type": "function", "function": {"name": "observe", "arguments": "{}"}}
    messages: list[Message] = [
        {"role": "system", "content": "Play."},
        {"role": "user", "content": "Begin."},
        {"role": "assistant", "content": None, "tool_calls": [call]},
        {"role": "tool", "content": "Nothing has happened.", "tool_call_id": "local0000"},
    ]
    tool = ToolSpec("observe", "Look.", {"type": "object", "properties": {}})
    if with_tools:
        return messages, [{"type": "function", "function": tool.to_json()}]
    return as_text(messages, [tool]), []


def _line(message: Message) -> tuple[Any, str]:
    role, text = message["role"], text_of(message)
    if role == "assistant":
        calls = [_call(**call["function"]) for call in calls_of(message)]
        return role, "\n".join(filter(None, [text, *calls]))
    return {"tool": "user", "developer": "system"}.get(role, role), text


def _call(name: str, arguments: str) -> str:
    return json.dumps({"name": name, "arguments": value_in(arguments or "{}")}, ensure_ascii=False)


def _with_tools(first: Message, tools: Sequence[ToolSpec]) -> Message:
    lines = "\n".join(f"- {tool.name}: {tool.description} {json.dumps(_properties(tool))}" for tool in tools)
    return {"role": first["role"], "content": f"{text_of(first)}\n\n{TOOLS.format(tools=lines)}"}


def _properties(tool: ToolSpec) -> dict[str, Any]:
    return dict(tool.parameters.get("properties") or {})


def grammar_of(tools: Sequence[ToolSpec]) -> str:
    """Return the grammar of a call of one of the tools, as compact JSON."""
    calls = [
        {
            "type": "object",
            "properties": {"name": {"const": tool.name}, "arguments": bounded(tool).parameters},
            "required": ["name", "arguments"],
            "additionalProperties": False,
        }
        for tool in tools
    ]
    # White space would be the model's to choose, and to pay for; this is how its earlier calls are shown to it.
    spaces = {"whitespace_flexible": False, "item_separator": ", ", "key_separator": ": "}
    schema = {"x-guidance": spaces, "anyOf": calls}
    try:
        return str(xllamacpp.json_schema_to_grammar(json.dumps(schema)))
    except (RuntimeError, ValueError, TypeError) as error:
        names = ", ".join(tool.name for tool in tools)
        raise InvalidArgumentError(f"The schemas of {names} cannot be made a grammar: {error}.") from error


def bounded(tool: ToolSpec) -> ToolSpec:
    """Return a tool of whose arguments all are required, and every text has an end."""
    longest = LONGEST_ACTION if tool.name == "act" else LONGEST_TEXT
    properties = {name: _with_end(schema, longest) for name, schema in _properties(tool).items()}
    required = list(tool.parameters.get("required") or properties)
    schema = {"type": "object", "properties": properties, "required": required, "additionalProperties": False}
    return ToolSpec(tool.name, tool.description, schema)


def _with_end(schema: Any, longest: int) -> Any:
    if isinstance(schema, Mapping) and schema.get("type") == "string" and "enum" not in schema:
        return {"maxLength": longest, "minLength": 1, **schema}
    if isinstance(schema, Mapping) and isinstance(kinds := schema.get("anyOf"), list):
        return {**schema, "anyOf": [_with_end(kind, longest) for kind in kinds]}
    return schema


def call_in(text: str) -> dict[str, Any] | None:
    """Return the call in a reply's text as `name` and `arguments`; None if a cap has cut it."""
    call = object_in(text)
    if call is None or not isinstance(call.get("name"), str):
        return None
    return {"name": call["name"], "arguments": json.dumps(call.get("arguments") or {}, ensure_ascii=False)}
