"""The figure of score against the number of a trial in its chain: whether a player gets better with what it carries."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.analysis.figures.style import (
    Series,
    draw_estimates,
    figure,
    legend_below,
    panels,
    sample_note,
    spread,
)
from smartplay_tools.evaluation.analysis.grouping import PlayedCell, by_cell
from smartplay_tools.evaluation.analysis.intervals import mean_estimates
from smartplay_tools.evaluation.analysis.pairs import MEASURES, sample
from smartplay_tools.records.rows import Row, grouped

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@figure
def score_against_trial(rows: Sequence[Row]) -> Figure:
    """Draw the mean score of every trial of a chain over all chains, with and without `carry`, a panel for each game.

    Without `carry` trials are put into chains of the same length, whose seeds are the same. Bars are 95 % intervals,
    each over the trials at one position of all chains, which are independent.
    """
    cells = by_cell(rows)
    lengths = {cell.rules["chain"] for cell, _ in cells if cell.rules["carry"] is not None}
    if len(lengths) != 1 or None in lengths:
        raise InvalidArgumentError(
            "There is nothing to draw: the rows need chains of one length (`carry` and `chain`)."
        )
    (length,) = lengths
    games = grouped(cells, lambda group: group[0].game)
    drawn, axes = panels(len(games), columns=3)
    counts: list[int] = []
    for panel, (game, own) in zip(axes, games.items(), strict=True):
        for index, (cell, members) in enumerate(own):
            places = sorted(grouped(members, lambda row: row["trial"] % length).items())
            estimates = mean_estimates([sample(each, MEASURES["score"]) for _, each in places])
            counts += [estimate.episodes for estimate in estimates]
            at = [place + 1 + spread(index, len(own)) for place, _ in places]
            draw_estimates(panel, at, estimates, Series.number(index), _name(cell))
        panel.set(title=game.removesuffix("-v0"), xlabel="trial of the chain", ylabel="score (points)")
        panel.set_xticks(range(1, length + 1))
    legend_below(drawn, columns=2, note=sample_note(counts))
    return drawn


def _name(cell: PlayedCell) -> str:
    carried = (
        "begins with nothing" if cell.rules["carry"] is None else f"with the {cell.rules['carry']} of the trial before"
    )
    return f"{cell.player}, {carried}"
