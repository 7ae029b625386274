"""The data types of the package: budgets, tools, calls, results, prompts, replies and players.

Types that are created at every call (`ToolCall`, `ToolResult`, `Prompt`) are dataclasses; types that are validated,
stored and read back (`Budget`, `EpisodeResult`) are pydantic models. Chat messages are dictionaries
(`smartplay_tools.types.messages`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from smartplay_tools.lazy import lazy_exports

if TYPE_CHECKING:
    from smartplay_tools.types.budget import (
        STRATEGIES as STRATEGIES,
        WORDS as WORDS,
        BeyondHistory as BeyondHistory,
        BeyondResult as BeyondResult,
        Budget as Budget,
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
    from smartplay_tools.types.recorded import Cap as Cap, Count as Count, Recorded as Recorded
    from smartplay_tools.types.result import (
        MISTAKES as MISTAKES,
        CarriedStore as CarriedStore,
        EndReason as EndReason,
        EpisodeResult as EpisodeResult,
        Progress as Progress,
        Tokens as Tokens,
        facts_as_html as facts_as_html,
    )
    from smartplay_tools.types.tool import (
        MEMORY_TOOL as MEMORY_TOOL,
        NOTES_TOOL as NOTES_TOOL,
        PAGES_TOOL as PAGES_TOOL,
        RECALL_TOOL as RECALL_TOOL,
        TOOL_NAMES as TOOL_NAMES,
        ObservationForm as ObservationForm,
        ToolCall as ToolCall,
        ToolResult as ToolResult,
        ToolSpec as ToolSpec,
    )
    from smartplay_tools.types.usage import MOST_TOKENS as MOST_TOKENS, SampledTokens as SampledTokens, Usage as Usage

if not TYPE_CHECKING:
    __getattr__, __dir__, __all__ = lazy_exports(
        __name__,
        {
            "smartplay_tools.types.budget": (
                "STRATEGIES WORDS BeyondHistory BeyondResult Budget RecordedBudget ResolvedBudget"
            ),
            "smartplay_tools.types.prompt": "AsyncPlayer Player Prompt Purpose Reply",
            "smartplay_tools.types.recorded": "Cap Count Recorded",
            "smartplay_tools.types.result": (
                "MISTAKES CarriedStore EndReason EpisodeResult Progress Tokens facts_as_html"
            ),
            "smartplay_tools.types.tool": (
                "MEMORY_TOOL NOTES_TOOL PAGES_TOOL RECALL_TOOL TOOL_NAMES ObservationForm ToolCall ToolResult ToolSpec"
            ),
            "smartplay_tools.types.usage": "MOST_TOKENS SampledTokens Usage",
        },
    )
