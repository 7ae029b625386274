"""The progress of a run, from its snapshots: while it is played, and as tables of an unfinished run.

`showing` draws live bars on a terminal and logs lines with times elsewhere. The bars fit a terminal of 80x24: games for
which there is no room share a line. `print_running` prints the tables of cells and of the episodes being played.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import reduce
from itertools import groupby
from operator import add

from rich.console import Group, RenderableType
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table

from smartplay_tools.cli.show import print_table
from smartplay_tools.evaluation.analysis.formats import Column, TextTable, columns, sections
from smartplay_tools.evaluation.run_folder.follower import CellSnapshot, RunSnapshot, Spending
from smartplay_tools.evaluation.runs.run_progress import OnSnapshot
from smartplay_tools.records.record import Record
from smartplay_tools.terminal import Console, Text, say
from smartplay_tools.types.quantities import short

LOG_SECONDS = 60.0
"""Seconds after which a log gets another line."""

OTHER_LINES = 7
"""Lines of the live display apart from those of games, including some free ones."""

SHOWN_EPISODES = 10
"""The most running episodes that are listed; the others are counted."""


@contextmanager
def showing(console: Console) -> Iterator[OnSnapshot]:
    """Show the progress of a run on a terminal as bars, elsewhere as lines."""
    if console.is_terminal:
        with Live(console=console, auto_refresh=False) as live:
            yield lambda snapshot: live.update(_screen(snapshot), refresh=True)
    else:
        yield _Log(console)


def _screen(snapshot: RunSnapshot) -> RenderableType:
    """Return a snapshot as bars, drawn for the current size of the terminal."""
    room = max(1, Console(stderr=True).size.height - OTHER_LINES)
    games = snapshot.games
    if len(games) > room:
        games = [*games[: room - 1], replace(reduce(add, games[room - 1 :]), game="other games")]
    table = Table(box=None, padding=(0, 1, 0, 0), show_header=False)
    table.add_column(overflow="ellipsis", no_wrap=True)
    table.add_column(width=12)
    table.add_column(justify="right", no_wrap=True)
    table.add_column(no_wrap=True)
    for game in games:
        words = f"score {game.score / game.finished:.2f}" if game.finished else ""
        failed = f"  {game.failed_attempts} failed" if game.failed_attempts else ""
        bar = ProgressBar(total=game.planned, completed=game.finished, width=12)
        table.add_row(game.game, bar, f"{game.finished}/{game.planned}", Text(words).append(failed, "red"))
    lines = [Text(snapshot.describe())]
    if warning := snapshot.warning:
        lines.append(Text(warning, style="yellow", no_wrap=True, overflow="ellipsis"))
    if error := snapshot.latest_error:
        lines.append(Text(f"latest failure: {error}", style="red", no_wrap=True, overflow="ellipsis"))
    return Group(table, *lines)


class _Log:
    """Lines with the time: at the start, at every tenth, every minute and the end, for failures and the first stall."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._tenth, self._last, self._words = -1, 0.0, ""
        self._failures: set[tuple[str, int]] | None = None
        self._has_warned = False

    def __call__(self, snapshot: RunSnapshot) -> None:
        """Log what has changed since the last snapshot."""
        self._log_failures(snapshot)
        if snapshot.warning and not self._has_warned:
            self._has_warned = True
            self._say(snapshot.warning)
        tenth = 10 * snapshot.finished // max(1, snapshot.planned)
        is_due = time.monotonic() - self._last >= LOG_SECONDS
        if tenth > self._tenth or is_due or (not snapshot.running and snapshot.describe() != self._words):
            self._tenth, self._last, self._words = tenth, time.monotonic(), snapshot.describe()
            self._say(self._words)

    def _log_failures(self, snapshot: RunSnapshot) -> None:
        before = self._failures
        self._failures = {(row["key"], row["attempt"]) for row in snapshot.failed_attempts}
        if before is not None:
            for row in snapshot.failed_attempts:
                if (row["key"], row["attempt"]) not in before:
                    name = ", ".join(filter(None, (row["game"], row["player"])))
                    self._say(f"failed: {row['key']} ({name}): {row['error'] or row['end_reason']}")

    def _say(self, words: str) -> None:
        self._console.print(f"{time.strftime('%H:%M:%S')} {words}", highlight=False, soft_wrap=True)


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
        say(f"Now: {snapshot.describe()}.\n")
    if snapshot.playing:
        print_table(console, live_table(snapshot.playing))


def spending_sentences(spending: Spending) -> list[str]:
    """Return a sentence about what a run has used in all, if any of it is not in its results or costs money."""
    total, others = spending.total, spending.other_attempts
    if not (others.tokens or others.unknown_calls or total.cost):
        return []
    sentence = f"Spent in all: {short(total.tokens)} tokens{_dollars(total.cost)}"
    if others.tokens:
        sentence += f", of them {short(others.tokens)} tokens{_dollars(others.cost)} in attempts without a result"
    if total.unknown_calls:
        calls = "1 call was" if total.unknown_calls == 1 else f"{total.unknown_calls} calls were"
        most = f"at most {short(total.unknown_tokens)} tokens{_dollars(total.unknown_cost)}"
        sentence += f". {calls} under way when the run or a worker stopped; whether they are charged is unknown, {most}"
    return [sentence + "."]


def _dollars(cost: float | None) -> str:
    return ", cost unknown" if cost is None else f", ${cost:.2f}" if cost else ""
