"""Runs in notebooks: tables and replays as the output of a cell, and rows as data frames.

Nothing here is needed outside of a notebook, which calls an object's `_repr_html_`. The code that computes tables and
replays is imported at first use, so that playing a run does not load it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from smartplay_tools.errors import InvalidArgumentError, extra_named
from smartplay_tools.evaluation.pages.report.page import render_report
from smartplay_tools.records.rows import Row
from smartplay_tools.visible import as_html

if TYPE_CHECKING:
    import pandas


_DTYPES = {"string": "string", "json": "string", "int64": "Int64", "float64": "Float64", "bool": "boolean"}
"""The data frame's type for each kind of column; all of them can be missing."""


def rows_to_pandas(rows: Sequence[Row]) -> pandas.DataFrame:
    """Return rows as a data frame with the columns of `write_csv`; without pandas, a `MissingExtraError`."""
    with extra_named("A data frame", "notebook"):
        import pandas
    from smartplay_tools.evaluation.analysis.tables import COLUMNS, flat

    frame = pandas.DataFrame([flat(row) for row in rows], columns=list(COLUMNS))
    return frame.astype({name: _DTYPES[kind] for name, (_, kind) in COLUMNS.items()})


def run_as_html(rows: Sequence[Row], failures: Sequence[Row], planned: int) -> str:
    """Return the progress of a run, its headline and its failures as markup."""
    from smartplay_tools.evaluation.analysis.formats import to_html
    from smartplay_tools.evaluation.analysis.run_tables import run_tables
    from smartplay_tools.evaluation.analysis.summary import summarize

    tables = to_html([*run_tables(rows, summarize(rows, failures))])
    return f"<p>{len(rows)} of {planned} episodes finished</p>\n{tables}"


def replay_widget(
    rows: Sequence[Row], transcript: Callable[[str], Path], episode: int | str | Row, height: int
) -> ReplayWidget:
    """Return the replay of an episode, given by its row, its index in the rows, or its key."""
    if isinstance(episode, Mapping):
        key = episode["key"]
    elif isinstance(episode, str):
        key = episode
    elif -len(rows) <= episode < len(rows):
        key = rows[episode]["key"]
    else:
        raise InvalidArgumentError(f"The run has {len(rows)} finished episodes, so {episode} is out of range.")
    if not transcript(key).exists():
        raise InvalidArgumentError(f"The run has no finished episode {key!r}.")
    return ReplayWidget(transcript(key), height=height)


class ReplayWidget:
    """The replay of one episode. A notebook shows it; `html` is the page that `write_report` would write."""

    def __init__(self, transcript: str | Path, *, height: int = 760) -> None:
        self.transcript, self.height = Path(transcript), height
        self.html = render_report(self.transcript, open_first=True)

    def _repr_html_(self) -> str:
        # The frame has its own origin, so that it cannot access the notebook.
        return (
            f'<iframe srcdoc="{as_html(self.html)}" sandbox="allow-scripts" width="100%" height="{self.height}" '
            'style="border: 1px solid #8886" title="Replay of an episode"></iframe>'
        )
