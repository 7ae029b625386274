"""Calls of an episode's tools from threads that are not the server's, in which an agent's tools run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from smartplay_tools import ToolResult, ToolSpec


@dataclass(frozen=True)
class FromThreads:
    """The tools of an episode, and a function that plays a call of one."""

    tools: tuple[ToolSpec, ...]
    call: Callable[[str, Any], ToolResult]
