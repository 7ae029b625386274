"""What the prompts of episodes show: prompts as rows, each with a cell for every turn so far.

Where the tokens went: every prompt of an episode stacked by its parts, and several episodes beside each other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.analysis.figures import style
from smartplay_tools.records.accounts import PARTS, Accounts, ShownAs, shown_turns
from smartplay_tools.records.record import Record
from smartplay_tools.transcript.events import ViewEvent, concerns_summary
from smartplay_tools.visible import visible

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["prompt_rows", "tokens_by_part"]

LOOKS: dict[ShownAs, tuple[str, str, str]] = {
    "whole": ("#0072B2", "white", "shown whole"),
    "trimmed": ("#56B4E9", "black", "shown without its words"),
    "masked": ("#E69F00", "black", "shown, its observation masked"),
    "notes": ("#CC79A7", "black", "kept for its notes"),
    "pinned": ("#CC79A7", "black", "pinned by a strategy"),
    "gone": ("#E6E6E6", "#8A8A8A", "gone"),
}
"""The colour of a cell, that of the number in it, and what it means."""

HEAD, SUMMARY = ("#6D5BB5", "white", "system, task and tools"), ("#8A6D1F", "white", "summary")
WIDE = 2.4
"""The width of head and summary, in cells."""


@style.figure
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
        axes.text(first + most + 0.4, y, f"{view['tokens']:,}{limit} tokens", va="center_baseline", color=style.GREY)
    axes.set(xlim=(0, first + most + 6), ylim=(len(rows) - 0.5, -0.5), xticks=[])
    axes.set_yticks(range(len(rows)), [visible(name) for name, _, _ in rows])
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


COLOURS = ("#9A8FC8", "#B08D57", "#E69F00", "#CC79A7", "#009E73", "#9ECAE9", "#0072B2", "#D55E00", "#BBBBBB", "#56B4E9")
"""The colours of `PARTS`. Their order, from the bottom upwards, is the same everywhere."""


@style.figure
def tokens_by_part(records: Mapping[str, Record]) -> Figure:
    """Draw the tokens of every prompt stacked by part, a panel for each record under its name."""
    drawn, axes = style.panels(len(records), size=(4.6, 2.6))
    counted = {name: _parts(name, record) for name, record in records.items()}
    highest = max(sum(parts) for prompts in counted.values() for parts in prompts)
    there = [at for at in range(len(PARTS)) if any(parts[at] for prompts in counted.values() for parts in prompts)]
    for panel, (name, prompts) in zip(axes, counted.items(), strict=True):
        layers = [[parts[at] for parts in prompts] for at in there]
        labels, colours = [list(PARTS.values())[at] for at in there], [COLOURS[at] for at in there]
        panel.stackplot(range(len(prompts)), layers, labels=labels, colors=colours, step="mid", linewidth=0)
        if (cap := records[name].budget["prompt_tokens"]) is not None:
            panel.axhline(cap, color=style.GREY, linestyle=(0, (4, 3)), linewidth=1.2, label="cap on every prompt")
        total = sum(map(sum, prompts))
        result = records[name].result_data
        score = "" if result is None else f", score {result['score']:g}"
        panel.set(title=f"{visible(name)}: {total / 1000:,.0f}k tokens{score}", xlabel="prompt", ylabel="tokens")
        panel.set(xlim=(0, max(1, len(prompts) - 1)), ylim=(0, 1.08 * highest))
    style.legend_below(drawn)
    return drawn


def _parts(name: str, record: Record) -> list[list[int]]:
    accounts = Accounts.of(record)
    if accounts is None:
        raise InvalidArgumentError(
            f"The prompts of {name} cannot be drawn: they do not belong to tool calls under a window, or were counted "
            "with a tokenizer that does not come with this package."
        )
    return [*accounts.prompts()]
