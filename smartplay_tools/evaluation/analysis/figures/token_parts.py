"""Where the tokens went: every prompt of an episode stacked by its parts, and several episodes beside each other."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.analysis.figures.style import GREY, figure, legend_below, panels
from smartplay_tools.records.accounts import PARTS, Accounts
from smartplay_tools.records.record import Record

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS = ("#9A8FC8", "#B08D57", "#E69F00", "#CC79A7", "#009E73", "#9ECAE9", "#0072B2", "#D55E00", "#BBBBBB", "#56B4E9")
"""The colours of `PARTS`. Their order, from the bottom upwards, is the same everywhere."""


@figure
def tokens_by_part(records: Mapping[str, Record]) -> Figure:
    """Draw the tokens of every prompt stacked by part, a panel for each record under its name."""
    drawn, axes = panels(len(records), size=(4.6, 2.6))
    counted = {name: _parts(name, record) for name, record in records.items()}
    highest = max(sum(parts) for prompts in counted.values() for parts in prompts)
    there = [at for at in range(len(PARTS)) if any(parts[at] for prompts in counted.values() for parts in prompts)]
    for panel, (name, prompts) in zip(axes, counted.items(), strict=True):
        layers = [[parts[at] for parts in prompts] for at in there]
        labels, colours = [list(PARTS.values())[at] for at in there], [COLOURS[at] for at in there]
        panel.stackplot(range(len(prompts)), layers, labels=labels, colors=colours, step="mid", linewidth=0)
        if (cap := records[name].budget["prompt_tokens"]) is not None:
            panel.axhline(cap, color=GREY, linestyle=(0, (4, 3)), linewidth=1.2, label="cap on every prompt")
        total = sum(map(sum, prompts))
        result = records[name].result_data
        score = "" if result is None else f", score {result['score']:g}"
        panel.set(title=f"{name}: {total / 1000:,.0f}k tokens{score}", xlabel="prompt", ylabel="tokens")
        panel.set(xlim=(0, max(1, len(prompts) - 1)), ylim=(0, 1.08 * highest))
    legend_below(drawn)
    return drawn


def _parts(name: str, record: Record) -> list[list[int]]:
    accounts = Accounts.of(record)
    if accounts is None:
        raise InvalidArgumentError(
            f"The prompts of {name} cannot be drawn: they do not belong to tool calls under a window, or were counted "
            "with a tokenizer that does not come with this package."
        )
    return [accounts.parts(view) for view in record.views]
