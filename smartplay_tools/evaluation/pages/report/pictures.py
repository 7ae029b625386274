"""The figures of a run, as images in the page.

They are images, not markup, because an SVG in an `img` element cannot run scripts.
"""

from __future__ import annotations

import base64
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from smartplay_tools.errors import SmartPlayError
from smartplay_tools.evaluation.analysis.figures import write_figures
from smartplay_tools.records.rows import Row
from smartplay_tools.records.run_folder import RunFolder

FOLDER = "figures"
"""The folder of a run's figures, as SVG."""


def figures(run: Path, rows: Sequence[Row]) -> Iterator[dict[str, str]]:
    """Yield name and image of a run's figures: those in its folder, or else those that can be drawn now of its rows.

    There are none without a run, without the extra `evaluation`, or for games that are not known here.
    """
    if not (run / "manifest.json").exists():
        return
    found = sorted((run / FOLDER).glob("*.svg"))
    with tempfile.TemporaryDirectory() as drawn:
        for file in found or _draw(run, rows, Path(drawn)):
            image = base64.b64encode(file.read_bytes()).decode("ascii")
            yield {"name": file.stem.replace("-", " "), "image": f"data:image/svg+xml;base64,{image}"}


def _draw(run: Path, rows: Sequence[Row], folder: Path) -> list[Path]:
    try:
        return write_figures(rows, folder, transcript=RunFolder(run).transcript, formats=["svg"])
    except SmartPlayError:
        return []
