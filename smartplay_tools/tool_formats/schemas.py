"""Schemas: a tool in the format of an interface, for requests to a model."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from smartplay_tools.context.prompts.wording import Wording, known
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.types import MEMORY_TOOL, ToolSpec

__all__ = ["SchemaFormat", "schema"]

SchemaFormat = Literal["openai", "responses", "anthropic", "json"]


def schema(tool: ToolSpec, form: SchemaFormat) -> dict[str, Any]:
    """Return a tool in the format of an interface: OpenAI chat, OpenAI Responses, Anthropic or JSON Schema.

    For OpenAI the game's tools are strict; an agent's own tool is, if its schema fits.
    For Anthropic, the tool `memory` of a budget with `memory_tokens` is the provider's own, which has no schema.
    """
    parameters = dict(tool.parameters)
    function = {"name": tool.name, "description": tool.description}
    strict = is_strict(parameters)
    match form:
        case "openai":
            return {"type": "function", "function": {**function, "parameters": parameters, "strict": strict}}
        case "responses":
            return {"type": "function", **function, "parameters": parameters, "strict": strict}
        case "anthropic" if tool.name == MEMORY_TOOL and _is_ours(tool):
            return {"type": "memory_20250818", "name": tool.name}
        case "anthropic":
            return {**function, "input_schema": parameters}
        case "json":
            return {**function, "parameters": parameters}
    raise InvalidArgumentError(f"There is no schema format {form!r}; known: openai, responses, anthropic, json.")


def _is_ours(tool: ToolSpec) -> bool:
    """Whether a tool with the name of the memory is that of this library, and not a host's own."""
    from smartplay_tools.context.strategies.memory import memory_spec

    specs = (memory_spec(1, Wording.of(version)) for version in known())
    return any(tool.parameters == spec.parameters for spec in specs)


STRICT = frozenset({"type", "title", "description", "enum", "properties", "required", "additionalProperties", "items"})
"""The keywords that a strict schema may use here; strict modes accept some more, and refuse the rest."""


def is_strict(schema: Any) -> bool:
    """Whether strict modes accept JSON Schema as it is: each object in it is closed, and requires all its properties.

    A provider refuses a request that calls another schema strict, even if the agent that offers the tool wants it.
    """
    if isinstance(schema, Mapping) and isinstance(kinds := schema.get("anyOf"), list | tuple):
        return schema.keys() <= {"anyOf", "title", "description"} and bool(kinds) and all(map(is_strict, kinds))
    if not isinstance(schema, Mapping) or not schema.keys() <= STRICT or not isinstance(schema.get("type"), str):
        return False
    if schema["type"] == "array":
        return is_strict(schema.get("items"))
    if schema["type"] != "object":
        return True
    properties, required = schema.get("properties"), schema.get("required")
    if not isinstance(properties, Mapping) or not isinstance(required, list | tuple):
        return False
    closed = schema.get("additionalProperties") is False
    requires_all = len(required) == len(properties) and all(name in required for name in properties)
    return closed and requires_all and all(map(is_strict, properties.values()))
