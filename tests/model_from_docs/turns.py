"""A turn of a conversation, and how a prompt shows it: whole, masked by a boundary, or with a bare reply."""

from __future__ import annotations

from dataclasses import dataclass, field

import smartplay_tools as sp

from .counting import text_of

MARKER = "[observation left the history window]"


@dataclass
class Item:
    """A message behind a reply: a result, or words of a user."""

    message: sp.Message
    date: int | None = None
    """The observation that a result is dated by; None for what does not age."""
    shows: int | None = None
    """The observation that a result of `act` or `observe` shows."""

    def seen(self, oldest: int | None) -> sp.Message:
        """Return it as a prompt shows it; `oldest` is None where all observations are masked."""
        if self.date is None or (oldest is not None and self.date >= oldest):
            return self.message
        return {**self.message, "content": MARKER}


@dataclass
class Turn:
    """A reply and what follows it."""

    reply: sp.Message
    step: int = 0
    """The newest observation of the game at its end."""
    items: list[Item] = field(default_factory=list)
    plays: bool = False
    """Whether it plays a step."""
    notes: str | None = None
    """The notes that it took last, "" if it cleared them."""

    def seen(self, oldest: int | None, words: int) -> list[sp.Message]:
        """Return the messages of the turn as a prompt shows them."""
        reply = self.reply
        has_words = text_of(reply) or reply.get("reasoning_content") or reply.get("provider_items")
        if self.step < words and reply.get("tool_calls") and has_words:
            bare = {key: value for key, value in reply.items() if key in ("role", "name", "tool_calls")}
            reply = {**bare, "content": None}  # type: ignore[typeddict-item]
        return [reply, *(item.seen(oldest) for item in self.items)]

    def shown(self, oldest: int | None) -> set[int]:
        """Return the observations that it shows unmasked."""
        return {
            item.shows for item in self.items if item.shows is not None and oldest is not None and item.shows >= oldest
        }
