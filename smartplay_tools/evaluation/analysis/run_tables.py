"""The tables of a run, in the order in which commands, pages and notebooks show them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from smartplay_tools.evaluation.analysis.details import details, failures_table
from smartplay_tools.evaluation.analysis.formats import TextTable
from smartplay_tools.evaluation.analysis.headline import headline
from smartplay_tools.evaluation.analysis.remembering import remembering_tables
from smartplay_tools.evaluation.analysis.repeats import repeated, repeats_table
from smartplay_tools.evaluation.analysis.summary import RunSummary
from smartplay_tools.evaluation.analysis.window_tables import points_tables
from smartplay_tools.evaluation.analysis.windows import compare_windows
from smartplay_tools.records.rows import Row


def run_tables(rows: Sequence[Row], summary: RunSummary, *, everything: bool = False) -> Iterator[TextTable]:
    """Yield a run's headline, and its failures and repeats, if any; or all its tables."""
    if summary.cells:
        yield headline(summary)
    if everything:
        yield from further_tables(rows, summary)
        return
    if summary.failures:
        yield failures_table(summary.failures)
    yield from _repeats(rows)


def further_tables(rows: Sequence[Row], summary: RunSummary) -> Iterator[TextTable]:
    """Yield all tables but the headline."""
    yield from details(summary)
    yield from remembering_tables(rows)
    yield from points_tables(compare_windows(rows))
    yield from _repeats(rows)


def _repeats(rows: Sequence[Row]) -> Iterator[TextTable]:
    if figures := repeated(rows):
        yield repeats_table(figures)
