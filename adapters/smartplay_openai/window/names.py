"""Which of the host's tools are the game's, under whatever names; which are foreign; and which one closes a run.

MCP clients put the server's name before a tool's, as in `mcp__smartplay__act`. The model behind the window knows the
game's own names, so calls are renamed on their way to the host.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from smartplay_openai.tool_choice import plainest_value
from smartplay_tools import ToolSpec
from smartplay_tools.types.messages import MessageToolCall


@dataclass(frozen=True)
class HostTools:
    """The tools of a request, told apart."""

    names: Mapping[str, str]
    """The game's tools that the host has: our name -> the host's."""
    foreign: tuple[ToolSpec, ...]
    closing: ToolSpec | None
    """The tool by which the host's framework wants a run to be closed."""

    hidden: tuple[str, ...] = ()
    """Names of other tools that the model is not shown."""

    def close(self, call_id: str, text: str) -> MessageToolCall:
        """Return the call that closes the host's run."""
        assert self.closing is not None
        function: Any = {"name": self.closing.name, "arguments": filled(self.closing.parameters, text)}
        return {"id": call_id, "type": "function", "function": function}


def filled(schema: Mapping[str, Any], text: str) -> str:
    """Return the plainest JSON of a schema, with a text in the first of its properties that may hold one."""
    value = plainest_value(schema)
    properties = schema.get("properties")
    for name, inner in properties.items() if isinstance(value, dict) and isinstance(properties, Mapping) else ():
        if isinstance(inner, Mapping) and inner.get("type", "string") in ("string", "any") and "enum" not in inner:
            value[name] = text
            break
    return json.dumps(value)


def tell_apart(
    tools: Sequence[ToolSpec], own: Sequence[ToolSpec], closing: str | None, *, only_game_tools: bool = False
) -> HostTools:
    """Tell the tools of a request apart; `own` are the game's, `closing` names the tool that closes a run.

    With `only_game_tools` the others are hidden.
    """
    names: dict[str, str] = {}
    foreign = []
    for tool in tools:
        ours = next((spec for spec in own if _is_same(tool, spec)), None)
        if ours is not None:
            names.setdefault(ours.name, tool.name)
        elif tool.name != closing:
            foreign.append(tool)
    closes = next((tool for tool in tools if tool.name == closing), None)
    if only_game_tools:
        return HostTools(names, (), closes, tuple(tool.name for tool in foreign))
    return HostTools(names, tuple(foreign), closes)


def _is_same(tool: ToolSpec, own: ToolSpec) -> bool:
    """Whether a tool is the game's: by its name, or by the end of its name and the beginning of its description."""
    if tool.name == own.name:
        return True
    before = tool.name.removesuffix(own.name)
    first_words = own.description[:40]
    return before != tool.name and before[-1] in "_-" and first_words in tool.description
