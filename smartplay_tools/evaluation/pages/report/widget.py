"""The replay page of one transcript in a frame, for notebooks."""

from __future__ import annotations

import html
from pathlib import Path

from smartplay_tools.evaluation.pages.report.page import render_report


class ReplayWidget:
    """The replay of one episode. A notebook shows it; `html` is the page that `write_report` would write."""

    def __init__(self, transcript: str | Path, *, height: int = 760) -> None:
        self.transcript, self.height = Path(transcript), height
        self.html = render_report(self.transcript, open_first=True)

    def _repr_html_(self) -> str:
        # The frame has its own origin, so that it cannot access the notebook.
        return (
            f'<iframe srcdoc="{html.escape(self.html)}" sandbox="allow-scripts" width="100%" height="{self.height}" '
            'style="border: 1px solid #8886" title="Replay of an episode"></iframe>'
        )
