"""The figure of score over steps in long games, from the records of episodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.analysis.figures.style import (
    Series,
    figure,
    from_zero,
    legend_below,
    panels,
    sample_note,
)
from smartplay_tools.evaluation.analysis.intervals import Sample, mean_estimates
from smartplay_tools.records.record import Record

if TYPE_CHECKING:
    from matplotlib.figure import Figure

POINTS = 60
"""The most steps at which a curve is drawn, since an interval is estimated at each of them."""

Walk = Sequence[float]
"""The score of an episode after 0, 1, 2, ... steps."""


def walk_of(transcript: str | Path) -> list[float]:
    """Return the score of an episode after every step, from its record."""
    walk = [0.0]
    for call in Record.read(transcript).calls:
        data = call["data"]
        if "score" in data:
            # If one call takes several steps, its score counts for all of them.
            walk += [data["score"]] * (data["step"] - (len(walk) - 1))
    return walk


@figure
def score_over_steps(walks: Mapping[str, Sequence[Walk]], *, title: str | None = None) -> Figure:
    """Draw the mean score of several groups of episodes over their steps, with bands of 95 % intervals.

    An episode that is over keeps its last score, so that a mean is always over all episodes. Groups with identical
    episodes share a line, since one would cover the other.
    """
    if not walks or not all(walks.values()):
        raise InvalidArgumentError("There is nothing to draw: every group needs at least one episode.")
    walks = _merged(walks)
    drawn, (axes,) = panels(1, size=(7.6, 4.2))
    longest = max(len(walk) for group in walks.values() for walk in group) - 1
    steps = sorted({round(longest * point / POINTS) for point in range(POINTS + 1)})
    for index, (name, group) in enumerate(walks.items()):
        look = Series.number(index)
        estimates = mean_estimates([Sample([walk[min(step, len(walk) - 1)] for walk in group]) for step in steps])
        means = [estimate.mean for estimate in estimates]
        axes.plot(
            steps, means, color=look.colour, linestyle=look.line, marker=look.marker, markevery=(index, 8), label=name
        )
        # Where there is no interval, as at the start, where all scores are 0, the band is as wide as a line.
        low, high = (
            [each.mean if (end := getattr(each, name)) is None else end for each in estimates]
            for name in ("low", "high")
        )
        axes.fill_between(steps, low, high, color=look.colour, alpha=0.13, linewidth=0)
    axes.set(title=title, xlabel="steps of the game", ylabel="mean score so far (points)", xlim=(0, longest))
    from_zero(axes, [score for group in walks.values() for walk in group for score in walk])
    axes.xaxis.set_major_formatter(lambda steps, _: f"{steps:,.0f}")
    axes.yaxis.set_major_formatter(lambda score, _: f"{score:,.0f}")
    legend_below(drawn, columns=2, note=sample_note(map(len, walks.values()), bars="bands"))
    return drawn


def _merged(walks: Mapping[str, Sequence[Walk]]) -> dict[str, Sequence[Walk]]:
    """Put groups with equal walks under one name."""
    merged: dict[str, Sequence[Walk]] = {}
    for name, group in walks.items():
        same = next((label for label, other in merged.items() if list(other) == list(group)), None)
        # The name changes, but not the position in the order.
        merged = {f"{label} = {name}" if label == same else label: other for label, other in merged.items()}
        if same is None:
            merged[name] = group
    return merged
