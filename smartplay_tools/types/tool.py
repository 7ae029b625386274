"""Tools, their calls and their results, and the names of the tools that an agent can have."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Literal

from smartplay_tools.types.pictures import Picture

TOOL_NAMES = ("observe", "act", "read_manual")
"""The tools that every agent has. There is no tool to reset, to seed or to read the score."""

NOTES_TOOL: Final = "take_notes"
"""The tool that an agent has in addition where the budget has `notes_tokens`."""

RECALL_TOOL: Final = "recall"
"""The tool that an agent has in addition where the budget has `recall_tokens`."""

PAGES_TOOL: Final = "read_result"
"""The tool that an agent has in addition where the budget has `beyond_result="offload"`."""

MEMORY_TOOL: Final = "memory"
"""The tool that an agent has in addition where the budget has `memory_tokens`."""

ObservationForm = Literal["text", "picture", "both"]
"""What an observation is: words, a picture that the game makes of itself, or both."""


@dataclass(frozen=True, slots=True)
class ToolSpec:
    """A tool as it is described to the model; `parameters` is JSON Schema, of the game's tools a strict one."""

    name: str
    description: str
    parameters: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class ToolCall:
    """A call of a tool. `arguments` is what the model sent: JSON text, or an object where the framework parsed it.

    `call_id` is the transport's idempotency key. It is never the model's own id, because models repeat ids.
    """

    name: str
    arguments: Any = None
    call_id: str | None = None


@dataclass(frozen=True, slots=True)
class ToolResult:
    """The answer to a call. The model sees exactly `text` and `picture`; `data` is for the harness and never shown."""

    text: str
    is_error: bool = False
    done: bool = False
    data: Mapping[str, Any] = field(default_factory=dict)
    picture: Picture | None = None
    """The picture of the observation, where the episode's observations are pictures."""
