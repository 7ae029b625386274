"""Which of the host's tools are the game's, under whatever names; which are foreign; and which one closes a run.

MCP clients put the server's name before a tool's, as in `mcp__smartplay__act`. The model behind the window knows the
game's own names, so calls are renamed on their way to the host.

`Notices` has the parts of a host's requests that do not reach the model: they are named with each answer, and logged
once an episode.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from smartplay_gateway.window.formats import CompletionRequest
from smartplay_tools import ToolSpec
from smartplay_tools.players.conversion import accepted_name
from smartplay_tools.players.wire import bad, plainest_value
from smartplay_tools.types.messages import MessageToolCall
from smartplay_tools.visible import logger


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
    foreign_names: Mapping[str, str] = field(default_factory=dict)
    """The foreign tools: the name that the model is shown -> the host's."""

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

    A tool of the host's with the name of one of the game's is shown to the model as `host_NAME`, and one whose name
    providers refuse by a name that they take. With `only_game_tools` all of the host's tools are hidden. Two that look
    like the same tool of the game's are refused: one of them may play another episode.
    """
    names: dict[str, str] = {}
    ours: set[str] = set()
    for spec in own:
        named = [tool.name for tool in tools if tool.name == spec.name]
        found = [tool.name for tool in tools if _is_described(tool, spec)] or named
        if len(found) > 1:
            raise bad(f"Two tools are the game's {spec.name}: {', '.join(found)}; offer those of one episode.", "tools")
        for name in found:
            names[spec.name] = name
            ours.add(name)
    foreign = [tool for tool in tools if tool.name not in ours and tool.name != closing]
    closes = next((tool for tool in tools if tool.name == closing), None)
    if only_game_tools:
        return HostTools(names, (), closes, tuple(tool.name for tool in foreign))
    taken, foreign_names = {spec.name for spec in own}, dict[str, str]()
    for tool in foreign:
        shown = accepted_name(tool.name)
        while shown in taken:
            shown = f"host_{shown}"
        taken.add(shown)
        foreign_names[shown] = tool.name
    renamed = (replace(tool, name=shown) for tool, shown in zip(foreign, foreign_names, strict=True))
    return HostTools(names, tuple(renamed), closes, foreign_names=foreign_names)


def _is_described(tool: ToolSpec, own: ToolSpec) -> bool:
    """Whether a tool is the game's by its name, or the end of it, and the beginning of its description."""
    before = tool.name.removesuffix(own.name)
    has_name = not before or (before != tool.name and before[-1] in "_-.:/")
    return has_name and own.description[:40] in tool.description


log = logger("smartplay_gateway.window")


@dataclass(frozen=True)
class Shown:
    """What the model is shown of the host's agent in addition to the game's window; all of it is counted."""

    only_game_tools: bool = False
    """Whether the host's other tools are hidden."""
    system: bool = False
    """Whether the host's instructions in its first request are shown."""

    def ignored(self, request: CompletionRequest, tools: HostTools) -> Iterator[str]:
        """Yield the parts of a request that the model is not shown."""
        for role, count in request.ignored.characters.items():
            if count and not (self.system and role in ("system", "developer")):
                yield f"{role} messages ({count:,} characters)"
        yield from (f"{kind} ({count:,})" for kind, count in request.ignored.kinds.items())
        if names := [*tools.hidden, *request.left_out]:
            yield f"the tools {', '.join(names)}"
        yield from request.ignored.fields


class Notices:
    """The ignored parts of an episode's requests.

    Arguments:
        handle: the episode's handle.
        shown: what the model is shown.
    """

    def __init__(self, handle: str, shown: Shown) -> None:
        self._handle, self._shown = handle, shown
        self.latest = ""
        """What was ignored of the latest request that had something to ignore."""

    def of(self, request: CompletionRequest, tools: HostTools) -> str:
        """Say which parts of a request the model is not shown."""
        return ", ".join(self._shown.ignored(request, tools))

    def note(self, request: CompletionRequest, tools: HostTools) -> None:
        """Take note of a request, and log the first one with ignored parts."""
        ignored = self.of(request, tools)
        if ignored and not self.latest:
            log.warning("%s: the model sees the game's window only; ignored: %s.", self._handle, ignored)
        self.latest = ignored or self.latest
