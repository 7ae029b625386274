"""The figure of areas under the curve: what each strategy keeps of full context, in one number for all caps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.analysis.area import Area
from smartplay_tools.evaluation.analysis.figures.style import (
    GREY,
    Series,
    figure,
    panels,
    sample_note,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ROW = 0.3
"""Inches of a row."""


@figure
def areas_under_curves(areas: Sequence[Area]) -> Figure:
    """Draw the area of every strategy with its 95 % interval, a panel for each game, a row for each strategy.

    0 is the random player, 1 is full context under every cap. Areas without a number are left out.
    """
    there = [each for each in areas if each.area is not None]
    if not there:
        raise InvalidArgumentError("There is nothing to draw: no strategy has an area under its curve.")
    games = list(dict.fromkeys(each.game for each in there))
    names = list(dict.fromkeys(each.name for each in there))
    drawn, axes = panels(len(games), columns=len(games), size=(5.2, ROW * len(names) + 1.0))
    look = Series.number(0)
    for panel, game in zip(axes, games, strict=True):
        for each in there:
            if each.game == game and each.area is not None and each.low is not None and each.high is not None:
                bars = [[each.area - each.low], [each.high - each.area]]
                panel.errorbar(
                    each.area, names.index(each.name), xerr=bars, color=look.colour, marker="o", capsize=2, linestyle=""
                )
        panel.axvline(1, color=GREY, linewidth=1)
        panel.set(title=game.removesuffix("-v0"), xlabel="area: 0 is random, 1 is full context")
        panel.set_ylim(len(names) - 0.5, -0.5)
        panel.set_yticks(range(len(names)), names if panel is axes[0] else [])
    drawn.supxlabel(sample_note([each.seeds for each in there]), fontsize=9)
    return drawn
