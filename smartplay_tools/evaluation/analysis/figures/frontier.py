"""The figure of score against tokens or cost, with the Pareto front of the cells."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.analysis.figures import style
from smartplay_tools.evaluation.analysis.figures.curves import finding
from smartplay_tools.evaluation.analysis.names import series_name, window_names
from smartplay_tools.evaluation.analysis.window_tables import marks_of
from smartplay_tools.evaluation.analysis.windows import WindowComparison, width
from smartplay_tools.types.groups import grouped
from smartplay_tools.types.quantities import typeset
from smartplay_tools.visible import visible

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.transforms import Bbox

Price = Literal["tokens", "cost"]

FRONT = "Pareto front (filled)"
STEPS = (1, 2, 2.5, 5, 10)
"""Distances of ticks."""

FLAT = 0.02
"""Scores or prices that differ by less than this share count as equal: an axis of their differences shows nothing."""

LABELS = {"tokens": "budget tokens per episode, prompts and replies", "cost": "cost per episode (USD)"}

PLACES = ((-6, 5, "right"), (7, -12, "left"), (-6, -12, "right"), (7, 5, "left"))
"""The possible places of a label: its offset to the right and up, in points, and its alignment. There are no points to
the upper left of a front, so that is tried first."""


@style.figure
def frontier(comparisons: Sequence[WindowComparison], *, price: Price = "tokens") -> Figure:
    """Draw the mean score of every cell against the price of an episode, with a panel for each game.

    The Pareto front is the stepped line; its cells are filled and, where there is room, named by their window,
    or by their player if all windows are the same. Bars are 95 % intervals.
    """
    priced = [c for c in comparisons if price in c.means]
    if not priced:
        raise InvalidArgumentError(f"There is nothing to draw: no episode of the run has {price}.")
    games = grouped(priced, lambda c: c.cell.game)
    players = list(dict.fromkeys(series_name(c, priced) for c in priced))
    drawn, axes = style.panels(len(games), size=(5.4, 4.2))
    for panel, members in zip(axes, games.values(), strict=True):
        for index, player in enumerate(players):
            own = [c for c in members if series_name(c, priced) == player]
            _draw_player(panel, own, price, style.Series.number(index), player)
        panel.set(title=finding(members), xlabel=LABELS[price], ylabel="mean score (points)")
        _scale(panel, members, price)
        front = sorted(_point(c, price) for c in members if _on_front(c, price))
        panel.step(*zip(*front, strict=True), where="post", color=style.GREY, linewidth=1.2, zorder=2, label=FRONT)
        style.mark_points(panel, [_point(c, price) for c in members], map(marks_of, members))
    notes = [style.sample_note(c.episodes for c in priced), *style.mark_notes(map(marks_of, priced))]
    style.legend_below(drawn, note="; ".join(notes))
    # Labels come last, because their free places depend on everything else.
    drawn.draw_without_rendering()
    for panel, members in zip(axes, games.values(), strict=True):
        _label(panel, members, price)
    return drawn


def _draw_player(axes: Axes, members: Sequence[WindowComparison], price: Price, look: style.Series, label: str) -> None:
    for on_front in (False, True):
        shown = [c for c in members if _on_front(c, price) is on_front]
        prices, scores = [c.means[price] for c in shown], [c.means["score"] for c in shown]
        axes.errorbar(
            [estimate.mean for estimate in prices],
            [estimate.mean for estimate in scores],
            xerr=style.bars(prices),
            yerr=style.bars(scores),
            fmt=look.marker,
            color=look.colour,
            markerfacecolor=look.colour if on_front else "white",
            elinewidth=0.9,
            capsize=2,
            zorder=4 if on_front else 3,
        )
    # The legend shows the marker, not the bars of one of its points.
    axes.plot([], [], linestyle="", marker=look.marker, color=look.colour, label=label)


def _scale(axes: Axes, members: Sequence[WindowComparison], price: Price) -> None:
    """Scale the axes so that differences of scores are visible but equal scores look equal, with separate ticks."""
    from matplotlib.ticker import MaxNLocator

    scores = [c.means["score"].mean for c in members]
    largest = max(map(abs, scores))
    if max(scores) - min(scores) < FLAT * largest or not largest:
        axes.set_ylim(min(0.0, 1.2 * min(scores)), max(1.2 * max(scores), 0.0) or 1.0)
    else:
        axes.margins(y=0.12)
    axes.margins(x=0.12)
    prices = [c.means[price].mean for c in members]
    if max(prices) - min(prices) < FLAT * max(prices):
        axes.set_xlim(0.5 * min(prices), 1.5 * max(prices) or 1.0)
    axes.xaxis.set_major_locator(MaxNLocator(5, steps=STEPS))
    axes.xaxis.set_major_formatter(lambda price, _: _tick(price))
    axes.yaxis.set_major_locator(MaxNLocator(6, steps=STEPS))
    axes.yaxis.set_major_formatter(lambda points, _: f"{points:,g}")


def _tick(price: float) -> str:
    """A tick's number with all its digits, only its zeros abbreviated, so that no two ticks have the same label."""
    for unit, size in (("M", 1_000_000), ("k", 1_000)):
        if abs(price) >= size:
            return f"{price / size:.6g}{unit}"
    return f"{price:.6g}"


def _label(axes: Axes, members: Sequence[WindowComparison], price: Price) -> None:
    """Label the cells of the front with their windows or players, where a label covers no point, label or axis."""
    # Of equal points the one with the narrowest window gets the label; the best scores are labelled first.
    windows = window_names([c.cell for c in members])
    front = [pair for pair in zip(members, windows, strict=True) if _on_front(pair[0], price)]
    front.sort(key=lambda pair: width(pair[0].cell.budget))
    front.sort(key=lambda pair: _point(pair[0], price), reverse=True)
    points = [axes.transData.transform(_point(c, price)) for c in members]
    marks = [text for text in axes.texts if set(text.get_text()) & set(style.MARK_NOTES)]
    taken: list[Bbox] = [mark.get_window_extent() for mark in marks]
    taken += [bar for c in members for bar in _bars(axes, c, price)]
    inside, named = axes.get_window_extent(), set()
    for comparison, window in front:
        if (point := _point(comparison, price)) in named:
            continue
        named.add(point)
        for right, up, side in PLACES:
            label = axes.annotate(
                typeset(window) if len(set(windows)) > 1 else visible(comparison.cell.player),
                point,
                (right, up),
                textcoords="offset points",
                ha=side,
                fontsize=8,
                zorder=5,
            )
            label.set_in_layout(False)
            box = label.get_window_extent()
            held = inside.x0 + 2 < box.x0 and box.x1 < inside.x1 and inside.y0 + 2 < box.y0 and box.y1 < inside.y1
            free = not any(box.contains(*other) for other in points) and not any(map(box.overlaps, taken))
            if held and free:
                taken.append(box)
                break
            label.remove()


def _bars(axes: Axes, comparison: WindowComparison, price: Price) -> list[Bbox]:
    """The places of a cell's two error bars, a point where it has no interval."""
    from matplotlib.transforms import Bbox

    (x, y), across, up = _point(comparison, price), comparison.means[price], comparison.means["score"]
    below, above = style.bars([across, up])
    ends = [[(x - below[0], y), (x + above[0], y)], [(x, y - below[1]), (x, y + above[1])]]
    return [Bbox(axes.transData.transform(pair)) for pair in ends]


def _point(comparison: WindowComparison, price: Price) -> tuple[float, float]:
    return comparison.means[price].mean, comparison.means["score"].mean


def _on_front(comparison: WindowComparison, price: Price) -> bool:
    return bool(comparison.on_token_front if price == "tokens" else comparison.on_cost_front)
