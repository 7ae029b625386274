"""Notes: the agent takes them with a tool, and their turn stays visible when older turns leave."""

from __future__ import annotations

from smartplay_tools.context.strategies.base import BudgetStrategy, StrategyTool, ToolAnswer
from smartplay_tools.context.tokens import TokenCounter
from smartplay_tools.context.turns import Turn
from smartplay_tools.types import NOTES_TOOL, Budget, ToolSpec
from smartplay_tools.types.arguments import text_parameters


class Notes(BudgetStrategy):
    """Adds `take_notes` and pins the turn with the newest notes that were accepted."""

    name = "notes_tokens"
    option_help = "Cap on notes, which the agent takes with a tool; none: no such tool."

    def __init__(self, budget: Budget, counter: TokenCounter) -> None:
        assert budget.notes_tokens is not None
        self._cap, self._counter = budget.notes_tokens, counter
        usage = f'Call {NOTES_TOOL} with {{"text": "..."}}.'
        self.tools = (StrategyTool(notes_spec(self._cap), "text", usage, self._take),)

    def pinned(self, turn: Turn) -> int | None:
        """Return the newest turn with notes."""
        return turn.notes

    def _take(self, text: str) -> ToolAnswer:
        """Accept notes that are within their cap; blank ones clear what was noted. Longer ones change nothing."""
        cap, tokens = self._cap, self._counter.text(text)
        if tokens > cap:
            reason = f"These notes have {tokens} tokens, more than {cap}. The earlier notes stand."
            return ToolAnswer(reason, mistake="notes")
        return ToolAnswer(f"Noted: {tokens} of {cap} tokens.", {"notes": "kept" if text.strip() else "cleared"})


def notes_spec(cap: int) -> ToolSpec:
    """Return the tool with which an agent takes notes of at most `cap` tokens."""
    description = "Replace your notes. They stay visible when older turns leave the window."
    return ToolSpec(NOTES_TOOL, description, text_parameters(text=f"The new notes, at most {cap} tokens."))
