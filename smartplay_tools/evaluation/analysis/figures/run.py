"""The figures of a run, as far as it has the data for them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from smartplay_tools.evaluation.analysis.beside import EARLY
from smartplay_tools.evaluation.analysis.figures.capability_dots import Scores, capability_dots
from smartplay_tools.evaluation.analysis.figures.curves import score_against_history, score_against_prompt_tokens
from smartplay_tools.evaluation.analysis.figures.frontier import frontier
from smartplay_tools.evaluation.analysis.figures.style import FORMATS, save_figure
from smartplay_tools.evaluation.analysis.grouping import by_cell
from smartplay_tools.evaluation.analysis.names import series_name
from smartplay_tools.evaluation.analysis.pairs import normalized_score, sample
from smartplay_tools.evaluation.analysis.windows import WindowComparison, compare_windows
from smartplay_tools.records.rows import Row

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def write_figures(
    rows: Sequence[Row],
    out: Path,
    *,
    formats: Sequence[str] = tuple(FORMATS),
    svg_text: bool = False,
) -> list[Path]:
    """Draw the figures of a run from its rows, write them into the folder `out`, and return the paths.

    `svg_text` is that of `save_figure`.
    """
    return [
        path
        for name, drawn in run_figures(rows).items()
        for path in save_figure(drawn, out / name, formats=formats, svg_text=svg_text)
    ]


def run_figures(rows: Sequence[Row]) -> dict[str, Figure]:
    """Return the figures of a run by name."""
    comparisons = compare_windows(rows)
    if not comparisons:
        return {}
    drawn: dict[str, Figure] = {}
    if _varies(comparisons, "history"):
        drawn["score-against-history"] = score_against_history(comparisons)
    if _varies(comparisons, "prompt_tokens"):
        drawn["score-against-prompt-tokens"] = score_against_prompt_tokens(comparisons)
    drawn["frontier"] = frontier(comparisons)
    if any(c.on_cost_front and c.means["cost"].mean > 0 for c in comparisons):
        drawn["frontier-of-cost"] = frontier(comparisons, price="cost")
    if profiles := _profiles(rows, comparisons):
        drawn["capabilities"] = capability_dots(profiles)
    return drawn


def _varies(comparisons: Sequence[WindowComparison], field: str) -> bool:
    """Whether a family has several values of a field."""
    return any(c.cell.budget[field] != c.reference.budget[field] for c in comparisons)


def _profiles(rows: Sequence[Row], comparisons: Sequence[WindowComparison]) -> dict[str, Scores]:
    """The normalised scores of every player in full context; empty unless they have two settings in common.

    In one setting all nine capabilities are the same number. A player is marked if any of its episodes ended early.
    """
    profiles: dict[str, dict[str, Sequence[float]]] = {}
    early = {series_name(each, comparisons) for each in comparisons if each.is_reference and each.ends}
    cells = by_cell(rows)
    for comparison in comparisons:
        members = next(own for cell, own in cells if cell == comparison.cell)
        normalized = sample(members, normalized_score).values
        if comparison.is_reference:
            profiles.setdefault(series_name(comparison, comparisons), {})
            if normalized:
                profiles[series_name(comparison, comparisons)][comparison.cell.game] = normalized
    common = set.intersection(*(set(profile) for profile in profiles.values()))
    marked = {name + EARLY * (name in early): profile for name, profile in profiles.items()}
    return dict(marked) if len(common) > 1 else {}
