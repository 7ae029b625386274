"""What a prompt showed of each turn before it, as a word for each turn; from the record alone, without a tokenizer."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Literal

from smartplay_tools.records.record import Record
from smartplay_tools.transcript.events import ViewEvent

ShownAs = Literal["whole", "bare", "masked", "notes", "gone"]
"""As it was said; without the words of its reply; with an observation masked; for the notes in it; not at all."""


def shown_turns(record: Record, view: ViewEvent) -> list[ShownAs]:
    """Return how a prompt showed every turn before it. An episode in the paper's protocol has no turns."""
    shown: list[ShownAs] = ["gone"] * view["turn"]
    masked = {turn for turn, _ in view.get("masked", [])} | set(_numbers(view.get("hidden", [])))
    oldest, words, pictures = view.get("oldest", 0), view.get("words", 0), view.get("pictures", 0)
    for turn in _numbers(view.get("turns", [])):
        if turn >= view["turn"]:  # a request for a summary is about the turn before it
            continue
        past = record.turns[turn]
        if turn == view.get("notes"):
            shown[turn] = "notes"
        elif turn in masked or past.masked(oldest, pictures):
            shown[turn] = "masked"
        else:
            shown[turn] = "bare" if past.step < words else "whole"
    return shown


def _numbers(ranges: Sequence[Sequence[int]]) -> Iterable[int]:
    return (turn for first, last in ranges for turn in range(first, last + 1))
