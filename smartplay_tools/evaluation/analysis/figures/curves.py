"""Figures of the score against the limits of a prompt: past steps and tokens.

The axis of a limit is ordinal: the limits that were played are placed at equal distances, from the narrowest window to
no limit. The labels are exact; the distance between two labels has no meaning.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.analysis.beside import grows
from smartplay_tools.evaluation.analysis.figures import style
from smartplay_tools.evaluation.analysis.names import series_name, window_name
from smartplay_tools.evaluation.analysis.pairs import is_control
from smartplay_tools.evaluation.analysis.window_tables import marks_of
from smartplay_tools.evaluation.analysis.windows import WINDOW, WindowComparison, is_widest_but, width
from smartplay_tools.types import Budget
from smartplay_tools.types.groups import grouped
from smartplay_tools.types.quantities import typeset
from smartplay_tools.visible import visible

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


UNLIMITED = {"history": "all", "prompt_tokens": "no cap"}


def finding(members: Sequence[WindowComparison]) -> str:
    """Return what the narrowest window of a game is shown to score beside its reference, as the title of a panel.

    Nothing is said where a score that only grows comes from different numbers of steps.
    """
    game = members[0].cell.game
    compared = [c for c in members if "score" in c.differences and not is_control(c.cell.player)]
    narrow = min(compared, key=lambda c: width(c.cell.budget), default=members[0])
    played = {c.means["steps"].mean for c in members if c.cell in (narrow.cell, narrow.reference)}
    if not compared or (grows(game) and len(played) > 1):
        return visible(game)
    less = narrow.together or narrow.differences["score"]
    low, high = less.low or 0, less.high or 0
    names = [window_name(cell).split(", ") for cell in (narrow.cell, narrow.reference)]
    one, other = (", ".join(part for part in own if part not in names[1 - at]) for at, own in enumerate(names))
    other = other or "without"
    said = f"{one} against {other}: {'equal' if less.is_zero else 'undecided'}"
    if low > 0 or high < 0:
        said = f"{one} scores {abs(less.mean):,.3g} {'more' if low > 0 else 'less'} than {other}"
    return f"{visible(game)}\n{typeset(said)}"


@style.figure
def score_against_history(comparisons: Sequence[WindowComparison]) -> Figure:
    """Draw mean scores against the past steps that a prompt may show, a panel for each game.

    A line is a player under the widest of the other limits; its bars are 95 % intervals.
    """
    return _score_against("history", "past steps visible (history)", comparisons)


@style.figure
def score_against_prompt_tokens(comparisons: Sequence[WindowComparison]) -> Figure:
    """Draw mean scores against the cap on prompts, a panel for each game; otherwise as `score_against_history`."""
    return _score_against("prompt_tokens", "cap on every prompt (budget tokens)", comparisons)


def _score_against(field: str, label: str, comparisons: Sequence[WindowComparison]) -> Figure:
    shown = [c for c in comparisons if is_widest_but(c, field)]
    if not shown:
        raise InvalidArgumentError("There is nothing to draw: the run has no finished episode.")
    games = grouped(shown, lambda c: c.cell.game)
    names = list(dict.fromkeys(series_name(c, shown) for c in shown))
    drawn, axes = style.panels(len(games))
    for panel, members in zip(axes, games.values(), strict=True):
        steps = sorted({c.cell.budget[field] for c in members}, key=_narrow_first)
        for index, name in enumerate(names):
            line = sorted((c for c in members if series_name(c, shown) == name), key=lambda c: _place(c, field, steps))
            positions = [_place(c, field, steps) + style.spread(index, len(names)) for c in line]
            if line:
                means = [c.means["score"] for c in line]
                style.draw_estimates(panel, positions, means, style.Series.number(index), name)
                points = [(x, mean.mean) for x, mean in zip(positions, means, strict=True)]
                style.mark_points(panel, points, map(marks_of, line))
        _draw_human(panel, members)
        panel.set(title=finding(members), xlabel=label, ylabel="mean score (points)")
        panel.yaxis.set_major_formatter(lambda points, _: f"{points:,g}")
        panel.set_xticks(range(len(steps)), [UNLIMITED[field] if step is None else f"{step:,}" for step in steps])
        style.from_zero(panel, [low for c in members if (low := c.means["score"].low) is not None] or [0])
    others = {Budget(**{name: c.cell.budget[name] for name in WINDOW if name != field}).describe() for c in shown}
    under = [f"under {others.pop()}"] if len(others) == 1 and len(shown) < len(comparisons) else []
    notes = [style.sample_note(c.episodes for c in shown), *under]
    notes += style.mark_notes(map(marks_of, shown))
    style.legend_below(drawn, note="; ".join(notes))
    return drawn


def _narrow_first(limit: float | None) -> float:
    return float("inf") if limit is None else limit


def _place(comparison: WindowComparison, field: str, steps: Sequence[Any]) -> int:
    return steps.index(comparison.cell.budget[field])


def _draw_human(axes: Axes, members: Iterable[WindowComparison]) -> None:
    """Draw the human score of a game, if scores may be compared with it."""
    comparable = [c.cell.spec for c in members if "normalized_score" in c.means]
    human = comparable[0].human_score if comparable and comparable[0] is not None else None
    if human is not None:
        axes.axhline(human, color=style.GREY, linestyle=(0, (1, 2)), linewidth=1.4, label="human (paper)")
