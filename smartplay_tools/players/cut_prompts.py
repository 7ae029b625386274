"""Servers that cut prompts without a word, noticed by their count: it stays the same, far below ours, which changes.

Ours has to change by more than a turn of a small game: prompts of a window that slides have almost one size, so two of
them may have equal counts, and a model that is sent no schemas of tools has counts far below ours.

Ollama cuts every prompt at its `num_ctx`, 4,096 tokens by default, and answers as if nothing were missing
(docs.ollama.com/context-length, and TauricResearch/TradingAgents#168; read on 29 November 2026).
"""

from __future__ import annotations

from smartplay_tools.types import Usage
from smartplay_tools.visible import logger

log = logger("smartplay_tools.players")

FAR_BELOW = 2 / 3
"""The tokenizers of models differ from that of the budgets by less than this."""

CHANGED = 0.1
"""The share of a prompt by which ours has to change."""


class CutPrompts:
    """Says once of a player that its server seems to cut prompts."""

    def __init__(self, player: str) -> None:
        self._player = player
        self._since: tuple[int, int] | None = None
        """Our count of the first prompt with the server's latest count, which is far below, and that count."""
        self._said = False

    def note(self, tokens: int, usage: Usage | None) -> None:
        """Compare the budget tokens of a prompt with what its server has counted."""
        count = 0 if usage is None else usage.prompt
        if self._said or not count or not tokens:
            return
        if count >= FAR_BELOW * tokens:
            self._since = None
        elif self._since is None or self._since[1] != count:
            self._since = tokens, count
        elif abs(tokens - self._since[0]) > CHANGED * tokens:
            self._said = True
            log.warning(
                "The server of %s has counted %s tokens in prompts of about %s and %s: it seems to cut them, and the "
                "model does not see what the record says. At Ollama raise num_ctx (OLLAMA_CONTEXT_LENGTH=%s ollama "
                "serve), or keep prompts below it with --prompt-tokens.",
                *(self._player, f"{count:,}", f"{self._since[0]:,}", f"{tokens:,}", 1 << (2 * tokens).bit_length()),
            )
