"""An episode as functions for the tools of an agent call it, from threads that are not the server's."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from smartplay_tools import ToolResult, ToolSpec


@dataclass(frozen=True)
class FromThreads:
    """The tools of an episode, and what plays a call of them."""

    tools: tuple[ToolSpec, ...]
    call: Callable[[str, Any], ToolResult]
