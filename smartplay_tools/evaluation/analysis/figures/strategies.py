"""What becomes of the past: score against tokens for every strategy, and what each changes, seed by seed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.analysis.figures.style import (
    GREY,
    Series,
    bars,
    draw_estimates,
    figure,
    legend_below,
    panels,
    sample_note,
    spread,
)
from smartplay_tools.evaluation.analysis.names import series_name, strategy_name
from smartplay_tools.evaluation.analysis.windows import WindowComparison, family
from smartplay_tools.types import STRATEGIES, ResolvedBudget

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ALONG = tuple(STRATEGIES)
"""The fields of the budget in which the cells that are compared differ."""


@figure
def effects_of_strategies(comparisons: Sequence[WindowComparison]) -> Figure:
    """Draw score against tokens, a panel for each game, and beside them paired differences and prefix-stable shares.

    A mark is a strategy under one window. `comparisons` are made along the strategies alone:
    `compare_windows(rows, along=ALONG)`, so that each is compared with plain dropping under the same window. Bars are
    95 % intervals.
    """
    windows = _windows(comparisons)
    if not windows:
        raise InvalidArgumentError("There is nothing to draw: the run has no two cells that differ in strategy alone.")
    shown = [c for members in windows.values() for c in members]
    games = list(dict.fromkeys(c.cell.game for c in shown))
    names = list(dict.fromkeys(strategy_name(c.cell) for c in shown))
    drawn, axes = panels(len(games) + 2)
    for panel, game in zip(axes, games, strict=False):
        for index, name in enumerate(names):
            cells = [c for c in shown if c.cell.game == game and strategy_name(c.cell) == name]
            line = sorted(cells, key=lambda c: c.means["tokens"].mean)
            tokens = [c.means["tokens"].mean for c in line]
            draw_estimates(panel, tokens, [c.means["score"] for c in line], Series.number(index), name)
        panel.set(title=game, xlabel="tokens an episode", ylabel="mean score (points)")
        panel.xaxis.set_major_formatter(lambda tokens, _: f"{tokens / 1000:,g}k")
    _draw_by_window(axes[-2], windows, names, "score", paired=True)
    axes[-2].axhline(0, color=GREY, linewidth=1)
    axes[-2].set(title="What a strategy does to the score", ylabel="score less that of dropping (points)")
    _draw_by_window(axes[-1], windows, names, "prefix_share", paired=False)
    axes[-1].set(title="What it does to the prompts", ylabel="prompt tokens in a stable prefix (%)", ylim=(0, 1))
    axes[-1].yaxis.set_major_formatter(lambda share, _: f"{100 * share:.0f}")
    legend_below(drawn, columns=3, note=sample_note(c.episodes for c in shown))
    return drawn


def _draw_by_window(
    panel: Axes, windows: Mapping[str, Sequence[WindowComparison]], names: Sequence[str], measure: str, *, paired: bool
) -> None:
    """Draw a measure of every strategy, a place for each window."""
    for index, name in enumerate(names):
        found = [
            (place + spread(index, len(names)), (c.differences if paired else c.means)[measure])
            for place, members in enumerate(windows.values())
            for c in members
            if strategy_name(c.cell) == name and measure in (c.differences if paired else c.means)
        ]
        if found:
            positions, estimates = zip(*found, strict=True)
            # Windows are not a scale, so nothing joins them.
            look = Series.number(index)
            means = [one.mean for one in estimates]
            panel.plot(positions, means, color=look.colour, marker=look.marker, linestyle="")
            panel.errorbar(positions, means, yerr=bars(estimates), color=look.colour, elinewidth=1.2, fmt="none")
    panel.set_xlim(-0.5, len(windows) - 0.5)
    panel.set_xticks(range(len(windows)), list(windows), fontsize=7)


def _windows(comparisons: Sequence[WindowComparison]) -> dict[str, list[WindowComparison]]:
    """The cells that share all but their strategy, by a short name; cells without a rival are left out."""
    families: dict[str, list[WindowComparison]] = {}
    for comparison in comparisons:
        families.setdefault(family(comparison.cell, ALONG), []).append(comparison)
    rivals = [members for members in families.values() if len(members) > 1]
    facts = [_facts(members[0], comparisons) for members in rivals]
    # A name has what tells its window from the others, and in any case the game.
    varied = (
        [place for place in range(len(facts[0])) if not place or len({fact[place] for fact in facts}) > 1]
        if facts
        else []
    )
    names = ["\n".join(fact[place] for place in varied) for fact in facts]
    return dict(zip(names, rivals, strict=True))


def _facts(comparison: WindowComparison, among: Sequence[WindowComparison]) -> tuple[str, ...]:
    """The game, the player and the window of a cell, each in a few words."""
    cell = comparison.cell
    window = ResolvedBudget(**cell.budget).words()
    family_name = cell.spec.family.replace("_", " ")
    games = {c.cell.game for c in among if c.cell.spec.family == cell.spec.family}
    game = family_name if len(games) == 1 else cell.game.removesuffix("-v0")
    return game, series_name(comparison, among), window["prompt_tokens"], window["slack"], window["history"]
