"""The data types of the package: budgets, tools, calls, results, prompts, replies and players.

Types that are created at every call (`ToolCall`, `ToolResult`, `Prompt`) are dataclasses; types that are validated,
stored and read back (`Budget`, `EpisodeResult`) are pydantic models. Chat messages are dictionaries
(`smartplay_tools.messages`).
"""

from smartplay_tools.types.budget import (
    STRATEGIES,
    WORDS,
    BeyondHistory,
    BeyondResult,
    Budget,
    RecordedBudget,
    ResolvedBudget,
)
from smartplay_tools.types.prompt import AsyncPlayer, Player, Prompt, Purpose, Reply
from smartplay_tools.types.recorded import Cap, Count, Recorded
from smartplay_tools.types.result import (
    MISTAKES,
    CarriedStore,
    EndReason,
    EpisodeResult,
    Progress,
    Tokens,
    facts_as_html,
)
from smartplay_tools.types.tool import (
    MEMORY_TOOL,
    NOTES_TOOL,
    PAGES_TOOL,
    RECALL_TOOL,
    TOOL_NAMES,
    ObservationForm,
    ToolCall,
    ToolResult,
    ToolSpec,
)
from smartplay_tools.types.usage import MOST_TOKENS, SampledTokens, Usage

__all__ = [
    "MEMORY_TOOL",
    "MISTAKES",
    "MOST_TOKENS",
    "NOTES_TOOL",
    "PAGES_TOOL",
    "RECALL_TOOL",
    "STRATEGIES",
    "TOOL_NAMES",
    "WORDS",
    "AsyncPlayer",
    "BeyondHistory",
    "BeyondResult",
    "Budget",
    "Cap",
    "CarriedStore",
    "Count",
    "EndReason",
    "EpisodeResult",
    "ObservationForm",
    "Player",
    "Progress",
    "Prompt",
    "Purpose",
    "Recorded",
    "RecordedBudget",
    "Reply",
    "ResolvedBudget",
    "SampledTokens",
    "Tokens",
    "ToolCall",
    "ToolResult",
    "ToolSpec",
    "Usage",
    "facts_as_html",
]
