"""Tool choice: which tools a reply may call, whether it must call one, and replies that follow the choice.

Agents rely on forcing a tool or forbidding all of them: a planning step may have to be text, a final answer a call.
Players do not support this. They are therefore shown only the allowed tools, and their reply is adapted if necessary: a
call that is not allowed becomes text, and a missing call becomes the simplest one that the tool's schema allows.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from smartplay_tools.players.wire.problems import bad, check_name
from smartplay_tools.types import Prompt, ToolSpec
from smartplay_tools.types.messages import Message, MessageToolCall, calls_of, text_of


@dataclass(frozen=True)
class ToolChoice:
    """The tool choice of a request; by default there is no restriction."""

    allowed: frozenset[str] | None = None
    """The tools that may be called; None: all of them."""
    must_call: bool = False
    at_most_one: bool = False

    def restrict(self, prompt: Prompt) -> Prompt:
        """Return the prompt with only the allowed tools; a prompt for a summary keeps all, as its player expects."""
        if self.allowed is None or prompt.purpose != "play":
            return prompt
        return replace(prompt, tools=tuple(tool for tool in prompt.tools if tool.name in self.allowed))

    def apply(self, message: Message, tools: Sequence[ToolSpec]) -> Message:
        """Return a message that follows the choice; `tools` are the allowed ones."""
        calls, kept = calls_of(message), list(calls_of(message))
        if self.allowed is not None or not tools:
            kept = [call for call in calls if call["function"]["name"] in (self.allowed or ())]
        if self.at_most_one:
            kept = kept[:1]
        if self.must_call and not kept:
            kept = [_plainest_call(tools)]
        if kept == list(calls):
            return message
        # The provider's items contain the original calls, so they are removed, too.
        fitting: Message = {"role": "assistant", "content": message["content"]}
        if kept:
            return {**fitting, "tool_calls": kept}
        return {**fitting, "content": text_of(message) or f"I would call {_as_words(calls)}."}


def read_tool_choice(body: Mapping[str, Any], tools: Sequence[ToolSpec], function_field: str | None) -> ToolChoice:
    """Return a request's choice; `function_field` is the field of the function's name, None if there is none."""
    choice, at_most_one = body.get("tool_choice"), body.get("parallel_tool_calls") is False
    if choice in (None, "auto"):
        return ToolChoice(at_most_one=at_most_one)
    if choice == "none":
        return ToolChoice(frozenset())
    if choice == "required":
        return ToolChoice(_checked_names({tool.name for tool in tools}, tools), True, at_most_one)
    if not isinstance(choice, Mapping):
        raise bad(f"tool_choice is none, auto, required or an object, not {choice!r}.", "tool_choice")
    if choice.get("type") == "allowed_tools":
        inner = choice.get("allowed_tools", choice)
        listed = inner.get("tools") if isinstance(inner, Mapping) else None
        if not isinstance(listed, list):
            raise bad("allowed_tools has a list of tools.", "tool_choice")
        names = {_name(tool, function_field) for tool in listed}
        return ToolChoice(_checked_names(names, tools), inner.get("mode") == "required", at_most_one)
    return ToolChoice(_checked_names({_name(choice, function_field)}, tools), True, at_most_one)


def _name(tool: Any, function_field: str | None) -> str:
    if not isinstance(tool, Mapping) or tool.get("type") != "function":
        raise bad("tool_choice names tools of the type function; others cannot be called here.", "tool_choice")
    holder = tool.get(function_field) if function_field else tool
    name = holder.get("name") if isinstance(holder, Mapping) else None
    check_name(name, "tool_choice")
    return str(name)


def _checked_names(names: set[str], tools: Sequence[ToolSpec]) -> frozenset[str]:
    if not names or not names <= {tool.name for tool in tools}:
        raise bad("tool_choice names a tool that the request does not have.", "tool_choice")
    return frozenset(names)


def _plainest_call(tools: Sequence[ToolSpec]) -> MessageToolCall:
    tool = min(tools, key=lambda tool: len(_required(tool.parameters)))
    arguments = json.dumps(plainest_value(tool.parameters))
    return {"id": "call_0", "type": "function", "function": {"name": tool.name, "arguments": arguments}}


def _required(schema: Mapping[str, Any]) -> list[str]:
    required = schema.get("required")
    return [name for name in required if isinstance(name, str)] if isinstance(required, list) else []


def plainest_value(schema: Any) -> Any:
    """The simplest value of a schema's type; requirements other than types and enums are ignored."""
    if not isinstance(schema, Mapping):
        return ""
    if isinstance(schema.get("enum"), list) and schema["enum"]:
        return schema["enum"][0]
    kind = schema.get("type")
    match kind[0] if isinstance(kind, list) and kind else kind:
        case "object":
            properties = schema.get("properties")
            schemas = properties if isinstance(properties, Mapping) else {}
            return {name: plainest_value(schemas.get(name)) for name in _required(schema)}
        case "array":
            return []
        case "integer" | "number":
            return 0
        case "boolean":
            return False
        case "null":
            return None
    return ""


def _as_words(calls: Sequence[MessageToolCall]) -> str:
    functions = (call["function"] for call in calls)
    return " and ".join(f"{function['name']} with {function['arguments']}" for function in functions) or "no tool"
