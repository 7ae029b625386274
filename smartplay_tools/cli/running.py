"""The progress of a run as tables of its cells and of the episodes that are being played."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

import typer
from rich.console import Console

from smartplay_tools.cli.show import print_table
from smartplay_tools.evaluation.analysis.formats import Column, TextTable, columns, sections
from smartplay_tools.evaluation.quantities import short
from smartplay_tools.evaluation.run_folder.snapshot import CellSnapshot, RunSnapshot, Spending
from smartplay_tools.records.record import Record

SHOWN_EPISODES = 10
"""The most running episodes that are listed; the others are counted."""


def status_table(snapshot: RunSnapshot) -> TextTable:
    """Return the progress of each cell of a run."""
    rows = sections((game, map(_status, cells)) for game, cells in groupby(snapshot.cells, lambda cell: cell.game))
    headings = columns("game and player", "finished", "planned", "running", "paused", "failed attempts")
    return TextTable("progress", headings, rows)


def _status(cell: CellSnapshot) -> tuple[str, ...]:
    numbers = (cell.finished, cell.planned, cell.running, cell.paused, cell.failed_attempts)
    return f"  {', '.join(filter(None, (cell.player, cell.asked)))}", *map(str, numbers)


def live_table(records: Sequence[Record]) -> TextTable:
    """Return the progress of running episodes, those without an event for the longest time first."""
    rows = tuple(
        (
            record.game or record.key,
            record.player,
            str(record.steps),
            str(record.totals.replies),
            short(record.totals.tokens),
            f"{record.silent_seconds:.0f} s",
        )
        for record in records[:SHOWN_EPISODES]
    )
    left = len(records) - SHOWN_EPISODES
    headings = (Column("game", words=True), *columns("player", "step", "calls", "tokens", "silent"))
    return TextTable("being played", headings, rows, (f"and {left} more",) if left > 0 else ())


def print_running(console: Console, snapshot: RunSnapshot) -> None:
    """Print the progress of an incomplete run."""
    print_table(console, status_table(snapshot))
    if snapshot.is_live:
        typer.echo(f"Now: {snapshot.describe()}.\n")
    if snapshot.playing:
        print_table(console, live_table(snapshot.playing))


def spending_sentence(spending: Spending) -> str:
    """Return a sentence about what a run has used in all, and which part of it is not in the results."""
    total, others = spending.total, spending.other_attempts
    sentence = f"Spent in all: {short(total.tokens)} tokens{_dollars(total.cost)}"
    if others.tokens:
        sentence += f", of them {short(others.tokens)} tokens{_dollars(others.cost)} in attempts without a result"
    if total.unknown_calls:
        calls = "1 call was" if total.unknown_calls == 1 else f"{total.unknown_calls} calls were"
        most = f"at most {short(total.unknown_tokens)} tokens{_dollars(total.unknown_cost)}"
        sentence += f". {calls} under way when the run was stopped; whether they are charged is unknown, {most}"
    return sentence + "."


def _dollars(cost: float | None) -> str:
    return ", cost unknown" if cost is None else f", ${cost:.2f}" if cost else ""


def spending_sentences(spending: Spending) -> list[str]:
    """Return the sentence about the total use of a run, if any of it is not in its results or costs money."""
    others = spending.other_attempts
    return [spending_sentence(spending)] if others.tokens or others.unknown_calls or spending.total.cost else []
