"""What stays and what leaves: prompts as rows, each with a cell for every turn so far."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.analysis.figures.style import GREY, figure
from smartplay_tools.records.accounts import ShownAs, shown_turns
from smartplay_tools.records.record import Record
from smartplay_tools.transcript.events import ViewEvent, concerns_summary

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LOOKS: dict[ShownAs, tuple[str, str, str]] = {
    "whole": ("#0072B2", "white", "shown whole"),
    "bare": ("#56B4E9", "black", "shown without its words"),
    "masked": ("#E69F00", "black", "shown, its observation masked"),
    "notes": ("#CC79A7", "black", "kept for its notes"),
    "gone": ("#E6E6E6", "#8A8A8A", "gone"),
}
"""The colour of a cell, that of the number in it, and what it means."""

HEAD, SUMMARY = ("#6D5BB5", "white", "system, task and tools"), ("#8A6D1F", "white", "summary")
WIDE = 2.4
"""The width of head and summary, in cells."""


@figure
def prompt_rows(rows: Sequence[tuple[str, Record, int]]) -> Figure:
    """Draw one prompt in each row, given as its name, its record, and the turn that it asks for."""
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch, Rectangle

    views = [_view(record, turn) for _, record, turn in rows]
    most = max(turn for _, _, turn in rows)
    has_summary = any(view.get("summary") for view in views)
    first = WIDE * (1 + has_summary)
    drawn = Figure(figsize=(9.2, 0.46 * len(rows) + 0.9), layout="constrained")
    axes = drawn.subplots()
    used: dict[str, str] = {HEAD[2]: HEAD[0]}

    def cell(x: float, y: int, width: float, look: tuple[str, str, str], text: str) -> None:
        used[look[2]] = look[0]
        axes.add_patch(Rectangle((x + 0.05, y - 0.36), width - 0.1, 0.72, color=look[0], linewidth=0))
        axes.text(x + width / 2, y, text, color=look[1], ha="center", va="center_baseline", fontsize=8)

    for y, ((_, record, _), view) in enumerate(zip(rows, views, strict=True)):
        cell(0, y, WIDE, HEAD, "head")
        if view.get("summary"):
            cell(WIDE, y, WIDE, SUMMARY, "summary")
        for turn, kind in enumerate(shown_turns(record, view)):
            cell(first + turn, y, 1, LOOKS[kind], str(turn))
        cap = record.budget["prompt_tokens"]
        limit = "" if cap is None else f" of {cap:,}"
        axes.text(first + most + 0.4, y, f"{view['tokens']:,}{limit} tokens", va="center_baseline", color=GREY)
    axes.set(xlim=(0, first + most + 6), ylim=(len(rows) - 0.5, -0.5), xticks=[])
    axes.set_yticks(range(len(rows)), [name for name, _, _ in rows])
    axes.tick_params(length=0)
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)
    handles = [Patch(color=colour, label=meaning) for meaning, colour in used.items()]
    drawn.legend(handles=handles, loc="outside lower center", ncols=min(4, len(handles)))
    return drawn


def _view(record: Record, turn: int) -> ViewEvent:
    views = [view for view in record.views if view["turn"] == turn and not concerns_summary(view)]
    if record.is_paper or not views:
        raise InvalidArgumentError(f"The record of {record.game} has no prompt of turn {turn} under a window.")
    return views[0]
