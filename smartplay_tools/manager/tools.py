"""Tools: the schemas of an agent's tools, in any of the three forms, as they are counted."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from typing import Any

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.manager.counting import Tokens
from smartplay_tools.manager.plain import plain
from smartplay_tools.types import ToolSpec

NAMES = ("type", "name", "server_label")
"""What a record has of a tool that its provider runs: the rest can hold the keys and headers of other servers."""


def plain_tool(tool: Any) -> Mapping[str, Any]:
    """Return a tool as plain data; a client's object is read by `model_dump`."""
    if isinstance(tool, Mapping):
        return tool  # an agent may keep its own data in it
    return tool.to_json() if isinstance(tool, ToolSpec) else plain(tool, "A tool")[0]


def recorded_tool(tool: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return what a record has of a tool: all that is counted of it."""
    return tool if _spec(tool) is not None else {name: tool[name] for name in NAMES if name in tool}


def specs_of(tools: Iterable[Mapping[str, Any]], extra: Tokens | None) -> tuple[list[ToolSpec], int]:
    """Return tools that can be counted, and the tokens of those that a provider runs.

    `extra` gives the tokens of the latter; without it they are an `InvalidArgumentError`.
    """
    specs: list[ToolSpec] = []
    tokens = 0
    for tool in tools:
        if (spec := _spec(tool)) is not None:
            specs.append(spec)
        elif extra is None:
            raise InvalidArgumentError(
                f"The tokens of the tool {tool.get('type')!r} cannot be counted, because its provider writes its "
                "schema; name them with extra_tokens."
            )
        else:
            tokens += extra(tool) if callable(extra) else extra
    return specs, tokens


def _spec(tool: Mapping[str, Any]) -> ToolSpec | None:
    """The tool as it is counted; None for one whose schema is not in it."""
    inner = tool.get("function") or tool.get("custom")
    own = inner if isinstance(inner, Mapping) else tool
    schema = own.get("parameters", own.get("input_schema"))
    if not isinstance(own.get("name"), str) or tool.get("type", "function") not in ("function", "custom"):
        return None
    description = str(own.get("description") or "")
    if schema is None and isinstance(own.get("format"), Mapping):  # a tool of free text, with its grammar
        description += json.dumps(own["format"], ensure_ascii=False)
    return ToolSpec(own["name"], description, schema or {})
