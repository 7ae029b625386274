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
    picture: int | None = None
    """The number of its picture in the conversation."""
    without: str = MARKER
    """What it reads without its picture."""

    def seen(self, oldest: int | None, pictures: int = 0) -> sp.Message:
        """Return it as a prompt shows it; `oldest` is None where all observations are masked.

        `pictures` is how many of the conversation's first pictures are left out.
        """
        if self.date is not None and (oldest is None or self.date < oldest):
            return {**self.message, "content": MARKER}
        if self.picture is not None and self.picture < pictures:
            return {**self.message, "content": self.without}
        return self.message


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

    def seen(self, oldest: int | None, words: int, pictures: int = 0) -> list[sp.Message]:
        """Return the messages of the turn as a prompt shows them."""
        reply = self.reply
        has_words = text_of(reply) or reply.get("reasoning_content") or reply.get("provider_items")
        if self.step < words and reply.get("tool_calls") and has_words:
            bare = {key: value for key, value in reply.items() if key in ("role", "name", "tool_calls")}
            reply = {**bare, "content": None}  # type: ignore[typeddict-item]
        return [reply, *(item.seen(oldest, pictures) for item in self.items)]

    def shown(self, oldest: int | None, pictures: int = 0) -> set[int]:
        """Return the observations that it shows: neither masked, nor without a picture that is all they are."""
        return {
            item.shows
            for item in self.items
            if item.shows is not None
            and oldest is not None
            and item.shows >= oldest
            and (item.picture is None or item.picture >= pictures or item.without != MARKER)
        }
