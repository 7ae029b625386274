"""What a prompt showed of each turn before it, as a word for each turn; from the record alone, without a tokenizer."""

from __future__ import annotations

from typing import Literal

from smartplay_tools.context.view import numbers_in
from smartplay_tools.records.record import Record
from smartplay_tools.transcript.events import ViewEvent

ShownAs = Literal["whole", "bare", "masked", "notes", "gone"]
"""In full; without the words of its reply; with an observation masked; only for its notes; not at all."""


def shown_turns(record: Record, view: ViewEvent) -> list[ShownAs]:
    """Return how a prompt showed every turn before it. An episode in the paper's protocol has no turns."""
    shown: list[ShownAs] = ["gone"] * view["turn"]
    masked = {turn for turn, _ in view.get("masked", [])} | set(numbers_in(view.get("hidden", [])))
    oldest, words, pictures = view.get("oldest", 0), view.get("words", 0), view.get("pictures", 0)
    for turn in numbers_in(view.get("turns", [])):
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
