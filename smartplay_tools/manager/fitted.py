"""FittedPrompt: what a context manager sends of a conversation, and what it does not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

__all__ = ["FittedPrompt"]


@dataclass(frozen=True)
class FittedPrompt:
    """The messages of a prompt, its tokens, and what became of every message that was given.

    Numbers are positions in the list that was given, from 0. A message of which nothing was changed is the object that
    was given.
    """

    messages: list[Any]
    """What to send, in the form of what was given."""
    tokens: int
    """Budget tokens of these messages, of `system`, tools and output schema, and of priming."""
    sources: Sequence[int | None]
    """For each message its number; None for one that was made here."""
    dropped: Sequence[int] = ()
    """Messages that are not shown."""
    masked: Sequence[int] = ()
    """Messages whose results are older than `history`, and read as a line that says so."""
    trimmed: Sequence[int] = ()
    """Replies that are shown with their calls alone."""
    elided: Sequence[int] = ()
    """Results whose pictures are left out."""
    cut: Sequence[int] = ()
    """Results that were longer than their cap, and end with a notice."""
    repaired: Sequence[int] = ()
    """Messages that were moved, changed or left out so that each call has its result."""
    made: int = 0
    """How many calls without a result were answered here."""
    uncertain: Sequence[int] = ()
    """Shown messages with encrypted parts, whose tokens are an estimate."""
    parts: Mapping[str, int] = field(default_factory=dict)
    """Tokens by part: `tools`, `head`, `pinned`, `turns`; priming is in `head`."""
