"""The context manager for agents of any framework: an exact window over messages that are not ours."""

from __future__ import annotations

from smartplay_tools.manager.fitted import FittedPrompt
from smartplay_tools.manager.manager import ContextManager
from smartplay_tools.manager.summaries import Summaries

__all__ = ["ContextManager", "FittedPrompt", "Summaries"]
