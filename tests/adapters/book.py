"""A book that the agents of every framework read page by page under one cap."""

from __future__ import annotations

CAP, PAGES = 1_000, 40
SYSTEM, TASK = "You read a book page by page.", "Read all pages."


def pages_of(turn: int, last: int = PAGES) -> list[int]:
    """The pages that a turn reads, from 1 on: several at once now and then, and none after the last turn."""
    return [] if turn > last else [turn, *([100 + turn, 200 + turn] if turn % 7 == 0 else [])]
