"""Prompts for models whose chat template knows no tools, how calls are written, and what every reply is bound to.

Many small models were never shown a tool, and their template drops the schemas without a word. So the tools are part of
the system message, a call is text in a reply, and a result is a user message. How a call is written, its format,
decides whether such a model can play at all: see `FORMATS`. While the model writes, llama.cpp allows only what
continues to a call: none is malformed unless a cap on the reply cuts it.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from smartplay_local.engine import xllamacpp
from smartplay_local.model_files import Format
from smartplay_tools import InvalidArgumentError, Message, ToolSpec
from smartplay_tools.types.arguments import object_in, value_in
from smartplay_tools.types.messages import calls_of, text_of

FORMATS: Mapping[Format, str] = {
    "template": "",
    "text": 'Answer with one JSON object and nothing else: {{"name": TOOL, "arguments": {{...}}}}',
    "call": "Answer with one call and nothing else, such as {example}",
    "bare": "Answer with the name of one action and nothing else, such as {action}",
    "words": "Answer with one short sentence, and on the next line with one call, such as {example}",
    "legal": "Answer with the name of one action and nothing else, such as {action}",
}
"""How calls can be written, in the order in which they are tried, and what the model is told of it.

"template" is the model's own chat template, and "text" a JSON object. "call" is `act(Rock)`, and "words" the same after
a sentence. "bare" is an action alone, which can be one that does not exist; under "legal" it is one of the game's.
"""

ALONE: tuple[Format, ...] = ("bare", "legal")
"""The formats that play actions and call no other tool."""

LONGEST_SENTENCE = 200
"""Characters of the sentence before a call."""

LONGEST_TEXT = 2_000
"""Characters of a text in a call's arguments without its own limit: a model that repeats itself has to stop."""

LONGEST_ACTION = 64
"""The same of an action, which has a name of a few words or a number."""


def as_text(messages: Iterable[Message], tools: Sequence[ToolSpec], form: Format = "text") -> list[Message]:
    """Return messages that any chat template can write: roles alternate, calls and results are text."""
    written: list[Message] = []
    for message in messages:
        role, text = _line(message, form)
        if written and written[-1]["role"] == role:
            written[-1] = {"role": role, "content": f"{text_of(written[-1])}\n\n{text}"}
        else:
            written.append({"role": role, "content": text})
    return [_with_tools(written[0], tools, form), *written[1:]] if tools and written else written


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


def _line(message: Message, form: Format) -> tuple[Any, str]:
    role, text = message["role"], text_of(message)
    if role == "assistant":
        calls = [_call(**call["function"], form=form) for call in calls_of(message)]
        return role, "\n".join(filter(None, [text, *calls]))
    return {"tool": "user", "developer": "system"}.get(role, role), text


def _call(name: str, arguments: str, form: Format) -> str:
    values = value_in(arguments or "{}")
    if form == "text":
        return json.dumps({"name": name, "arguments": values}, ensure_ascii=False)
    texts = map(str, values.values() if isinstance(values, dict) else [values])
    return "".join(texts) if form in ALONE and name == "act" else f"{name}({', '.join(texts)})"


def _with_tools(first: Message, tools: Sequence[ToolSpec], form: Format) -> Message:
    example = (actions_of(tools) or [""])[0]
    how = FORMATS[form].format(action=example, example=_call("act", json.dumps({"action": example}), "call"))
    if form in ALONE:
        described = "\n".join(tool.description for tool in tools if tool.name == "act")
    elif form == "text":
        listed = (f"- {tool.name}: {tool.description} {json.dumps(_properties(tool))}" for tool in tools)
        described = "\n".join(["Tools:", *listed])
    else:
        listed = (f"- {tool.name}({', '.join(_properties(tool))}): {tool.description}" for tool in tools)
        described = "\n".join(["Tools:", *listed])
    return {"role": first["role"], "content": f"{text_of(first)}\n\n{described}\n\n{how}"}


def actions_of(tools: Iterable[ToolSpec]) -> list[str]:
    """Return the names of the legal actions, which the description of `act` lists."""
    return [
        name for tool in tools if tool.name == "act" for name in re.findall(r"^\d+\. (.+)$", tool.description, re.M)
    ]


def _properties(tool: ToolSpec) -> dict[str, Any]:
    return dict(tool.parameters.get("properties") or {})


def grammar_of(tools: Sequence[ToolSpec], form: Format = "text") -> str:
    """Return the grammar of a call of one of the tools; an `InvalidArgumentError` if a format has none for a tool."""
    return _grammar_of_json(tools) if form == "text" else f"%llguidance {{}}\nstart: {_rule(tools, form)}\n"


def _rule(tools: Sequence[ToolSpec], form: Format) -> str:
    """What a reply in a format of words may be, in the syntax of Lark."""
    for tool in tools:
        if form in ALONE and tool.name not in ("act", "observe", "read_manual"):
            raise InvalidArgumentError(f"format={form} plays actions alone and cannot call {tool.name}; choose call.")
        if len(_properties(tool)) > 1:
            raise InvalidArgumentError(f"format={form} has no form for the arguments of {tool.name}; choose text.")
    names = actions_of(tools)
    if form == "legal" and names:
        return " | ".join(json.dumps(name, ensure_ascii=False) for name in names)
    # A closing parenthesis ends a call, unless an action has one.
    character = r"[^\n]" if any(mark in name for name in names for mark in "()") else r"[^\n()]"
    if form in ALONE:
        return rf"/[^\n]{{1,{LONGEST_ACTION}}}/"
    calls = []
    for tool in tools:
        longest = LONGEST_ACTION if tool.name == "act" else LONGEST_TEXT
        argument = f" /{character}{{1,{longest}}}/" if _properties(tool) else ""
        calls.append(f'"{tool.name}("{argument} ")"')
    sentence = rf'/[^\n]{{1,{LONGEST_SENTENCE}}}/ "\n" ' if form == "words" else ""
    return f"{sentence}({' | '.join(calls)})"


def _grammar_of_json(tools: Sequence[ToolSpec]) -> str:
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


def argument_of(tool: ToolSpec) -> str | None:
    """Return the name of a tool's first argument; None if it takes none."""
    return next(iter(_properties(tool)), None)


def call_in(text: str, argument_of: Mapping[str, str | None], form: Format) -> tuple[str, dict[str, Any] | None]:
    """Return the words before the call in a reply, and the call as `name` and `arguments`; None if a cap has cut it.

    `argument_of` names the argument of each tool, None for a tool without one.
    """
    if form == "text":
        call = object_in(text)
        if call is None or not isinstance(call.get("name"), str):
            return text, None
        return "", _function(call["name"], call.get("arguments") or {})
    if form in ALONE:
        return "", _function("act", {"action": text.strip()}) if text.strip() else None
    *words, last = text.strip().split("\n") or [""]
    called = re.fullmatch(r"(\w+)\((.*)\)", last)
    if called is None or called[1] not in argument_of:
        return text, None
    argument = argument_of[called[1]]
    return "\n".join(words), _function(called[1], {} if argument is None else {argument: called[2]})


def _function(name: str, arguments: Mapping[str, Any]) -> dict[str, Any]:
    return {"name": name, "arguments": json.dumps(arguments, ensure_ascii=False)}
