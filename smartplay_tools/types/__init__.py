"""The data types of the package: budgets, tools, calls, results, prompts, replies and players.

Types that are created at every call (`ToolCall`, `ToolResult`, `Prompt`) are dataclasses; types that are validated,
stored and read back (`Budget`, `EpisodeResult`) are pydantic models. Chat messages are dictionaries
(`smartplay_tools.types.messages`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from smartplay_tools.registry import lazy_exports

if TYPE_CHECKING:
    from smartplay_tools.types.budget import (
        STRATEGIES as STRATEGIES,
        WORDS as WORDS,
        Budget as Budget,
        Cap as Cap,
        Recorded as Recorded,
        RecordedBudget as RecordedBudget,
        ResolvedBudget as ResolvedBudget,
    )
    from smartplay_tools.types.prompt import (
        AsyncPlayer as AsyncPlayer,
        Player as Player,
        Prompt as Prompt,
        Purpose as Purpose,
        Reply as Reply,
    )
    from smartplay_tools.types.result import (
        MEMORY_TOOL as MEMORY_TOOL,
        MISTAKES as MISTAKES,
        NOTES_TOOL as NOTES_TOOL,
        PAGES_TOOL as PAGES_TOOL,
        RECALL_TOOL as RECALL_TOOL,
        TOOL_NAMES as TOOL_NAMES,
        CarriedStore as CarriedStore,
        EndReason as EndReason,
        EpisodeResult as EpisodeResult,
        ObservationForm as ObservationForm,
        Progress as Progress,
        SampledTokens as SampledTokens,
        Tokens as Tokens,
        ToolCall as ToolCall,
        ToolResult as ToolResult,
        ToolSpec as ToolSpec,
        Usage as Usage,
    )

if not TYPE_CHECKING:
    __getattr__, __dir__, __all__ = lazy_exports(__name__)
