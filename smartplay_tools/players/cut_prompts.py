"""Servers that cut prompts without a word, noticed by their own count: it stays the same while ours is far above it.

Ours has to differ between the two prompts: in a game whose results are of one size, two prompts may have equal counts.

Ollama cuts every prompt at its `num_ctx`, 4,096 tokens by default, and answers as if nothing were missing
(docs.ollama.com/context-length, and TauricResearch/TradingAgents#168; read on 29 November 2026).
"""

from __future__ import annotations

from smartplay_tools.types import Usage
from smartplay_tools.visible import logger

log = logger("smartplay_tools.players")

FAR_BELOW = 2 / 3
"""The tokenizers of models differ from that of the budgets by less than this."""


class CutPrompts:
    """Says once of a player that its server seems to cut prompts."""

    def __init__(self, player: str) -> None:
        self._player = player
        self._before: tuple[int, int] | None = None
        """Our count and the server's of the last prompt, if the latter is far below."""
        self._said = False

    def note(self, tokens: int, usage: Usage | None) -> None:
        """Compare the budget tokens of a prompt with what its server has counted."""
        count = 0 if usage is None else usage.prompt
        if self._said or not count or not tokens:
            return
        before, self._before = self._before, (tokens, count) if count < FAR_BELOW * tokens else None
        if self._before and before and before[0] != tokens and before[1] == count:
            self._said = True
            log.warning(
                "The server of %s has counted %s tokens in each of two prompts, one of which has about %s: it seems to "
                "cut them, and the model does not see what the record says. At Ollama raise num_ctx "
                "(OLLAMA_CONTEXT_LENGTH=%s ollama serve), or keep prompts below it with --prompt-tokens.",
                *(self._player, f"{count:,}", f"{tokens:,}", 1 << (2 * tokens).bit_length()),
            )
