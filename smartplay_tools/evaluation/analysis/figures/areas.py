"""The figure of areas under the curve: what each strategy keeps of the widest window, in one number for all caps."""

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
from smartplay_tools.groups import grouped

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ROW = 0.3
"""Inches of a row."""


@figure
def areas_under_curves(areas: Sequence[Area]) -> Figure:
    """Draw the area of every strategy with its 95 % interval, a panel for each game, a row for each strategy.

    0 is the random player, 1 is the player's widest window. Areas without a number are left out. A player that is the
    same in all rows stands below the panels.
    """
    there = [each for each in areas if each.area is not None]
    if not there:
        raise InvalidArgumentError("There is nothing to draw: no strategy has an area under its curve.")
    by_game = grouped(there, lambda each: each.game)
    rows = max(map(len, by_game.values()))
    players = {each.name.partition(", ")[0] for each in there}
    shared = f"{players.pop()}, " if len(players) == 1 else ""
    drawn, axes = panels(len(by_game), size=(5.2, ROW * rows + 1.0))
    look = Series.number(0)
    for panel, (game, own) in zip(axes, by_game.items(), strict=True):
        for at, each in enumerate(own):
            assert each.area is not None
            assert each.low is not None
            assert each.high is not None
            bars = [[each.area - each.low], [each.high - each.area]]
            panel.errorbar(each.area, at, xerr=bars, color=look.colour, marker="o", capsize=2, linestyle="")
        panel.axvline(1, color=GREY, linewidth=1)
        panel.set(title=game.removesuffix("-v0"), xlabel="0 is random, 1 is full context")
        panel.set_ylim(len(own) - 0.5, -0.5)
        panel.set_yticks(range(len(own)), [each.name.removeprefix(shared) for each in own])
    drawn.supxlabel(f"{shared}area under the curve; {sample_note([each.seeds for each in there])}", fontsize=9)
    return drawn
