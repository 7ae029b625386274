"""What a notebook offers for a run or a sweep: data frames, replays and tables as the output of a cell.

`pages.notebook` makes all of them and is imported at first use, so playing a run loads neither pages nor statistics.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from smartplay_tools.records.rows import Row

if TYPE_CHECKING:
    import pandas

    from smartplay_tools.evaluation.pages.report.widget import ReplayWidget


def is_notebook() -> bool:
    """Return whether the output of this program is shown below the cells of a notebook."""
    ipython = sys.modules.get("IPython")  # a notebook has imported it
    shell = None if ipython is None else ipython.get_ipython()
    return shell is not None and hasattr(shell, "kernel")


class InNotebook:
    """The notebook methods of runs and sweeps, which have `rows`, `failures`, `planned` and `transcript`."""

    rows: Any
    failures: Any
    planned: Any
    transcript: Any

    def to_pandas(self) -> pandas.DataFrame:
        """Return the finished episodes as a data frame, one per row; needs pandas."""
        from smartplay_tools.evaluation.pages.notebook import rows_to_pandas

        return rows_to_pandas(self.rows)

    def show(self, episode: int | str | Row = 0, *, height: int = 760) -> ReplayWidget:
        """Return the replay of an episode, which a notebook shows below the cell.

        `episode` is its index in `rows`, its key or its row; `height` is that of the frame in pixels.
        """
        from smartplay_tools.evaluation.pages.notebook import replay_widget

        return replay_widget(self.rows, self.transcript, episode, height)

    def _repr_html_(self) -> str:
        from smartplay_tools.evaluation.pages.notebook import run_as_html

        return run_as_html(self.rows, self.failures, self.planned)
