"""The figures of runs, as images in the page.

They are images, not markup, because an SVG in an `img` element cannot run scripts.
"""

from __future__ import annotations

import base64
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from smartplay_tools.errors import SmartPlayError
from smartplay_tools.evaluation.analysis.figures.run import write_figures
from smartplay_tools.evaluation.analysis.grouping import by_cell
from smartplay_tools.evaluation.pages.report.sources import ShownRun


def figures(runs: Sequence[ShownRun]) -> Iterator[dict[str, str]]:
    """Yield name and image of the figures of runs, which share them, so that what is to be compared stands in one.

    There are none without a run, without the extra `evaluation`, or for games that are not known here.
    """
    runs = [run for run in runs if run.sources.manifest]
    with tempfile.TemporaryDirectory() as folder:
        for file in _draw(runs, Path(folder)):
            image = base64.b64encode(file.read_bytes()).decode("ascii")
            yield {"name": file.stem.replace("-", " "), "image": f"data:image/svg+xml;base64,{image}"}


def _draw(runs: Sequence[ShownRun], folder: Path) -> list[Path]:
    rows = [row for run in runs for row in run.sources.rows]
    try:
        if len(runs) > 1 and len(by_cell(rows)) < sum(len(by_cell(run.sources.rows)) for run in runs):
            # Two runs have played the same: they are told apart by their letters.
            rows = [{**row, "player": f"{run.letter} {row['player']}"} for run in runs for row in run.sources.rows]
        return write_figures(rows, folder, formats=["svg"])
    except SmartPlayError:
        return []
