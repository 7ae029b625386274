"""Notes: the agent takes them with a tool, and their turn stays visible when older turns leave."""

from __future__ import annotations

from collections.abc import Iterable

from smartplay_tools.context.prompts.wording import Wording
from smartplay_tools.context.strategies.base import BudgetStrategy, StrategyTool, ToolAnswer
from smartplay_tools.context.tokens import TokenCounter
from smartplay_tools.context.turns import Turn
from smartplay_tools.transcript.events import CallEvent
from smartplay_tools.types import NOTES_TOOL, Budget, ToolSpec
from smartplay_tools.types.arguments import read, text_parameters


class Notes(BudgetStrategy):
    """Adds `take_notes` and pins the turn with the newest notes that were accepted."""

    name = "notes_tokens"
    option_help = "Cap on notes, which the agent takes with a tool; none: no such tool."
    records_pin_as = "notes"

    def __init__(self, budget: Budget, counter: TokenCounter, words: Wording) -> None:
        assert budget.notes_tokens is not None
        self._cap, self._counter, self._words = budget.notes_tokens, counter, words
        spec = notes_spec(self._cap, words)
        self.tools = (StrategyTool(spec, "text", words("take_notes_usage"), self._take),)

    def pinned(self, turn: Turn) -> int | None:
        """Return the newest turn with notes."""
        return turn.notes

    def _take(self, text: str) -> ToolAnswer:
        """Accept notes that are within their cap; blank ones clear what was noted. Longer ones change nothing."""
        cap, tokens = self._cap, self._counter.text(text)
        if tokens > cap:
            return ToolAnswer(self._words("notes_too_long", tokens=tokens, cap=cap), mistake="notes")
        noted = self._words("noted", tokens=tokens, cap=cap)
        return ToolAnswer(noted, {"notes": "kept" if text.strip() else "cleared"})


class NotesStore:
    """The newest notes that were accepted; the message that ends the head shows them."""

    field = "notes_tokens"
    kept = "notes"

    @staticmethod
    def after(calls: Iterable[CallEvent], before: str | None, words: Wording) -> str | None:
        """Return the newest notes; the earlier trial's if none were taken, None if the newest call cleared them."""
        for call in calls:
            if call["name"] == NOTES_TOOL and (done := call["data"].get("notes")) is not None:
                before = str((read(call["arguments"]).values or {})["text"]) if done == "kept" else None
        return before


def notes_spec(cap: int, words: Wording) -> ToolSpec:
    """Return the tool with which an agent takes notes of at most `cap` tokens."""
    return ToolSpec(NOTES_TOOL, words("take_notes"), text_parameters(text=words("take_notes_text", cap=cap)))
