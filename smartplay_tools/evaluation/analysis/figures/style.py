"""The style of all figures, and how they are written.

Colours are those of Okabe and Ito, which people with any of the common colour-vision deficiencies can distinguish.
Every series also has its own marker and line style, so that colour is never the only difference. Legends are below the
panels, where there is no data, and state the number of episodes of a mean and what the bars are. The same figure always
has the same bytes, because it contains no date and no random ids.

matplotlib is imported when a figure is drawn, and never its `pyplot`, which keeps a global list of open windows.
"""

from __future__ import annotations

import functools
import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec

from smartplay_tools.errors import InvalidArgumentError, extra_named
from smartplay_tools.evaluation.analysis.beside import EARLY
from smartplay_tools.evaluation.analysis.headline import CUT
from smartplay_tools.statistics.intervals import MeanEstimate
from smartplay_tools.types.quantities import typeset

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["save_figure"]

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Okabe and Ito's palette, without the yellow that is too pale for a line on white."""
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")
LINES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)))
"""The lengths of the three lists have no common divisor, so that many series differ in their combination."""

WIDEST_SPREAD = 0.6
"""How far apart the first and the last of several series stand at most, of a distance of 1 between two places."""

LETTERS_PER_INCH = 14
"""How many letters of a legend's title fit into an inch."""

LEGEND_ROW = 0.22
"""Inches that every further row of a legend adds to a figure, so that the panels keep their height."""

MARK_NOTES = {CUT: "tool results were cut", EARLY: "episodes ended before their game did"}

GREY = "#6E6E6E"
"""The colour of references: the human score, the paper's models."""

FORMATS = {"png": ("Software",), "svg": ("Date", "Creator"), "pdf": ("CreationDate", "Creator", "Producer")}
"""The formats of a figure, each with the metadata that is left out: the same figure has the same bytes."""

Given = ParamSpec("Given")


def figure(draw: Callable[Given, Figure]) -> Callable[Given, Figure]:
    """Decorate a function that draws a figure: it draws in the common style, and needs matplotlib."""

    @functools.wraps(draw)
    def styled(*args: Given.args, **kwargs: Given.kwargs) -> Figure:
        with _common_style():
            return draw(*args, **kwargs)

    return styled


@contextmanager
def _common_style(**others: str) -> Iterator[None]:
    """Set matplotlib's settings for all figures, and others; without matplotlib, a `MissingExtraError`."""
    with extra_named("Drawing figures", "evaluation"):
        import matplotlib.style

    file = resources.files(__package__).joinpath("figures.mplstyle")
    with resources.as_file(file) as path, matplotlib.style.context([path, others]):
        yield


def panels(count: int, *, columns: int = 2, size: tuple[float, float] = (4.6, 3.4)) -> tuple[Figure, Sequence[Axes]]:
    """Return a figure and its `count` panels, in rows of at most `columns`, with room for a legend below."""
    from matplotlib.figure import Figure

    columns = min(columns, count)
    rows = -(-count // columns)
    drawn = Figure(figsize=(size[0] * columns, size[1] * rows + 0.5))
    # In inches: between two rows, a title needs a gap to the axis above it.
    drawn.set_layout_engine("constrained", h_pad=0.1 if rows > 1 else None)
    axes = list(drawn.subplots(rows, columns, squeeze=False).flat)
    for spare in axes[count:]:
        spare.remove()
    return drawn, axes[:count]


@dataclass(frozen=True)
class Series:
    """The colour, marker and line style of one series."""

    colour: str
    marker: str
    line: Any

    @classmethod
    def number(cls, index: int) -> Series:
        """The look of the series with that index."""
        return cls(COLOURS[index % len(COLOURS)], MARKERS[index % len(MARKERS)], LINES[index % len(LINES)])


def draw_estimates(
    axes: Axes, positions: Sequence[float], estimates: Sequence[MeanEstimate], look: Series, label: str | None
) -> None:
    """Draw means as a line with markers, and their intervals, if any, as bars."""
    means = [estimate.mean for estimate in estimates]
    axes.plot(positions, means, color=look.colour, marker=look.marker, linestyle=look.line, label=label)
    axes.errorbar(positions, means, yerr=bars(estimates), color=look.colour, capsize=3, elinewidth=1.2, fmt="none")


def draw_dots(
    axes: Axes,
    estimates: Sequence[MeanEstimate],
    rows: Sequence[float],
    look: Series,
    label: str | None = None,
    marks: Sequence[str] = (),
) -> None:
    """Draw means as dots in rows, marked if need be, and their intervals, if any, as bars to the left and right."""
    means = [estimate.mean for estimate in estimates]
    axes.plot(means, rows, color=look.colour, marker=look.marker, linestyle="", label=label)
    axes.errorbar(means, rows, xerr=bars(estimates), color=look.colour, elinewidth=1.2, capsize=2, fmt="none")
    mark_points(axes, list(zip(means, rows, strict=True))[: len(marks)], marks)


def bars(estimates: Sequence[MeanEstimate]) -> list[list[float]]:
    """The lengths of intervals below and above their means; 0 if there is no interval."""
    below = [0.0 if estimate.low is None else estimate.mean - estimate.low for estimate in estimates]
    above = [0.0 if estimate.high is None else estimate.high - estimate.mean for estimate in estimates]
    return [below, above]


def sample_note(episodes: Iterable[int]) -> str:
    """Return a note with the number of episodes of the means, and what the bars are."""
    counts = sorted(set(episodes))
    many = f"{counts[0]}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
    return f"means of n = {many} episodes; bars: 95 % intervals"


def mark_notes(marks: Iterable[str]) -> list[str]:
    """Return what the marks in a figure mean."""
    shown = "".join(marks)
    return [f"{mark}: {note}" for mark, note in MARK_NOTES.items() if mark in shown]


def mark_points(axes: Axes, points: Iterable[tuple[float, float]], marks: Iterable[str]) -> None:
    """Mark points whose scores are not those of less memory alone: `MARK_NOTES` has the reasons."""
    for point, mark in zip(points, marks, strict=True):
        if mark:
            axes.annotate(mark, point, (5, 5), textcoords="offset points", fontsize=11, fontweight="bold", zorder=6)


def spread(index: int, count: int) -> float:
    """How far series `index` of `count` stands beside its place, so that intervals do not cover each other."""
    return min(0.08, WIDEST_SPREAD / count) * (index - (count - 1) / 2)


def from_zero(axes: Axes, values: Iterable[float]) -> None:
    """Let the axis of scores begin at 0, or below if there are negative scores."""
    lowest, top = min(values), axes.get_ylim()[1]
    # A marker at the lowest score is not cut off.
    near = lowest < 0.05 * top
    axes.set_ylim(bottom=lowest - 0.06 * (top - lowest) if lowest < 0 or near else 0)


def legend_below(drawn: Figure, *, columns: int = 4, note: str = "") -> None:
    """Add one legend for all panels below them, with each series once. The note is its title.

    It has as many columns as fit beside each other, and at most `columns`.
    """
    entries: dict[str, Any] = {}
    for axes in drawn.axes:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            entries.setdefault(typeset(label), handle)
    width, height = drawn.get_size_inches()
    for count in range(min(columns, len(entries)), 0, -1):
        legend = drawn.legend(
            list(entries.values()),
            list(entries),
            loc="outside lower center",
            ncols=count,
            handlelength=3.2,
            title="\n".join(textwrap.wrap(typeset(note), int(LETTERS_PER_INCH * width))) or None,
            title_fontsize=9,
        )
        if count == 1 or legend.get_window_extent().width <= drawn.bbox.width:
            further = -(-len(entries) // count) - 1
            drawn.set_size_inches(width, height + LEGEND_ROW * further)
            break
        legend.remove()


def save_figure(
    drawn: Figure, stem: str | Path, *, formats: Sequence[str] = tuple(FORMATS), svg_text: bool = False
) -> list[Path]:
    """Write a figure as STEM.png, STEM.svg and STEM.pdf, or in some of these formats, and return the paths.

    With `svg_text` the words of an SVG are text, which can be searched and edited but depends on the reader's fonts;
    else they are paths, which look the same everywhere.
    """
    stem = Path(stem)
    if not stem.name:
        raise InvalidArgumentError("Name a figure by a path without suffix, such as figures/frontier.")
    if unknown := [name for name in formats if name not in FORMATS]:
        raise InvalidArgumentError(f"A figure is written as {', '.join(FORMATS)}, not {unknown[0]!r}.")
    stem.parent.mkdir(parents=True, exist_ok=True)
    written = []
    with _common_style(**{"svg.fonttype": "none"} if svg_text else {}):
        for name in formats:
            written.append(stem.with_name(f"{stem.name}.{name}"))
            drawn.savefig(written[-1], metadata=dict.fromkeys(FORMATS[name]))
    return written
