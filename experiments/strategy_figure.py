"""The figure of what each strategy changes, seed by seed, and what it costs, a row for each."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import compress
from typing import TYPE_CHECKING

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.analysis.figures.style import GREY, Series, draw_dots, figure, panels, sample_note
from smartplay_tools.evaluation.analysis.names import series_name, strategy_name
from smartplay_tools.evaluation.analysis.windows import WindowComparison, family
from smartplay_tools.evaluation.quantities import typeset
from smartplay_tools.records.rows import grouped
from smartplay_tools.types import STRATEGIES, ResolvedBudget

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ALONG = tuple(STRATEGIES)
"""The fields of the budget in which the cells that are compared differ."""


MEASURES = {
    "score": ("What a strategy does to the score", "score less that of {reference} (points)"),
    "tokens": ("What it costs", "tokens an episode"),
    "prefix_share": ("What it does to the prompts", "prompt tokens in a stable prefix (%)"),
}
"""The panels, from left to right: their titles and the labels of their axes."""

ROW = 0.24
"""Inches of a row."""


@figure
def effects_of_strategies(comparisons: Sequence[WindowComparison]) -> Figure:
    """Draw a row for every strategy under every window: the paired difference of scores, tokens, stable prefixes.

    `comparisons` are made along the strategies alone: `compare_windows(rows, along=ALONG)`, so that each is compared
    with plain dropping under the same window. Bars are 95 % intervals.
    """
    windows = _windows(comparisons)
    if not windows:
        raise InvalidArgumentError("There is nothing to draw: the run has no two cells that differ in strategy alone.")
    names = list(dict.fromkeys(strategy_name(c.cell) for members in windows.values() for c in members))
    rows: list[WindowComparison | None] = []
    labels = []
    for window, members in windows.items():
        rows += [None, *members]  # a row for the name of the window
        labels += [window.replace("\n", ", "), *(strategy_name(c.cell) for c in members)]
    drawn, axes = panels(len(MEASURES), columns=len(MEASURES), size=(4.2, ROW * len(rows) + 0.9))
    # Without a cell that drops, another strategy is what the others are compared with.
    references = {strategy_name(c.cell) for c in rows if c is not None and "score" not in c.differences}
    reference = references.pop() if len(references) == 1 else "the first"
    for panel, (measure, (title, label)) in zip(axes, MEASURES.items(), strict=True):
        for index, name in enumerate(names):
            own = [(at, c) for at, c in enumerate(rows) if c is not None and strategy_name(c.cell) == name]
            _draw(panel, own, measure, Series.number(index))
        panel.set(title=title, xlabel=typeset(label.format(reference=reference)), ylim=(len(rows) - 0.5, -0.5))
        panel.set_yticks(range(len(rows)), list(map(typeset, labels)) if panel is axes[0] else [])
    for at, text in enumerate(axes[0].get_yticklabels()):
        text.set_fontweight("bold" if rows[at] is None else "normal")
    axes[0].axvline(0, color=GREY, linewidth=1)
    axes[1].xaxis.set_major_formatter(lambda tokens, _: f"{tokens / 1000:,g}k")
    axes[1].set_xlim(left=0)
    axes[2].set_xlim(0, 1)
    axes[2].xaxis.set_major_formatter(lambda share, _: f"{100 * share:.0f}")
    drawn.supxlabel(sample_note(c.episodes for c in rows if c is not None), fontsize=9)
    return drawn


def _draw(panel: Axes, rows: Sequence[tuple[int, WindowComparison]], measure: str, look: Series) -> None:
    """Draw a measure of one strategy in its rows; dropping itself has no difference."""
    estimates = [(at, (c.differences if measure == "score" else c.means).get(measure)) for at, c in rows]
    there = [(at, estimate) for at, estimate in estimates if estimate is not None]
    if there:
        places, values = zip(*there, strict=True)
        draw_dots(panel, values, places, look)


def _windows(comparisons: Sequence[WindowComparison]) -> dict[str, list[WindowComparison]]:
    """The cells that share all but their strategy, by a short name; cells without a rival are left out."""
    families = grouped(comparisons, lambda comparison: family(comparison.cell, ALONG))
    rivals = [members for members in families.values() if len(members) > 1]
    facts = [_facts(members[0], comparisons) for members in rivals]
    # A name has what tells its window from the others, and in any case the game.
    varied = [not place or len(set(column)) > 1 for place, column in enumerate(zip(*facts, strict=True))]
    names = ["\n".join(compress(fact, varied)) for fact in facts]
    return dict(zip(names, rivals, strict=True))


def _facts(comparison: WindowComparison, among: Sequence[WindowComparison]) -> tuple[str, ...]:
    """The game, the player and the window of a cell, each in a few words."""
    cell = comparison.cell
    window = ResolvedBudget(**cell.budget).words()
    family_name = cell.spec.family.replace("_", " ")
    games = {c.cell.game for c in among if c.cell.spec.family == cell.spec.family}
    game = family_name if len(games) == 1 else cell.game.removesuffix("-v0")
    return game, series_name(comparison, among), window["prompt_tokens"], window["slack"], window["history"]
