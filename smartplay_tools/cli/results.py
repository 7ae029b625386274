"""The command `results`, which shows the results of runs, also of unfinished ones."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from smartplay_tools.cli import options, program
from smartplay_tools.cli.formats import FormatOption, print_tables
from smartplay_tools.cli.options import Format
from smartplay_tools.cli.progress import spending_sentences
from smartplay_tools.cli.show import print_table, table_console
from smartplay_tools.cli.threads import print_threads, thread_files
from smartplay_tools.evaluation.analysis.formats import Column, TextTable
from smartplay_tools.evaluation.analysis.headline import TERMS
from smartplay_tools.evaluation.analysis.repeats import as_json as repeats_json, repeated
from smartplay_tools.evaluation.analysis.run_tables import run_tables
from smartplay_tools.evaluation.analysis.summary import RunSummary, summarize
from smartplay_tools.evaluation.analysis.tables import cell_rows, summary_json, write_csv
from smartplay_tools.evaluation.run_folder.folder import RunFolder, read_each
from smartplay_tools.evaluation.run_folder.follower import RunSnapshot, run_snapshot
from smartplay_tools.records.rows import Row, unplayed
from smartplay_tools.terminal import Console, Text, say

NOW = ("calls", "steps", "tokens", "cost", "stalled", "began_again")
"""The figures of a run that is being played."""

NAMED = 10
"""The most cells without a finished episode that are named."""


@dataclass(frozen=True)
class _Shown:
    """The data of a run, read once."""

    folder: RunFolder
    rows: list[Row]
    snapshot: RunSnapshot
    summary: RunSummary


def results(
    folders: Annotated[
        list[Path],
        typer.Argument(metavar="DIR...", help="Folders of runs, or context records.", show_default=False),
    ],
    everything: Annotated[bool, typer.Option("--all", help="Show all tables, not only the first.")] = False,
    explain: Annotated[bool, typer.Option("--explain", help="Explain the terms in the tables.")] = False,
    form: FormatOption = Format.TEXT,
    as_json: options.Json = False,
    csv: Annotated[Path | None, typer.Option(help="Write a CSV file with a row for each episode.")] = None,
) -> None:
    """Show the scores of runs with intervals, tokens and cost; with --all also mistakes, ends and differences.

    Of a run in progress, the finished episodes are shown. Of records of a context manager, a row for each thread is.

    Example: smartplay-tools results runs/first --all --csv first.csv
    """
    form = Format.JSON if as_json else form
    if files := thread_files(folders):
        print_threads(files, form)
        return
    shown = read_each(folders, _read)
    if csv is not None:
        several = len(shown) > 1
        write_csv([{"run": str(run.folder.path), **row} if several else row for run in shown for row in run.rows], csv)
    if form is Format.TEXT:
        console = table_console()
        for run in shown:
            _show(console, run, everything=everything)
        terms = TextTable(
            "meaning of the terms", (Column("term", words=True), Column("meaning", words=True)), tuple(TERMS.items())
        )
        print_tables(form, [terms] if explain else [])
        print_next(console, folders, everything=everything)
        return
    tables = [
        table.of_run(str(run.folder.path)) if len(shown) > 1 else table
        for run in shown
        for table in run_tables(run.rows, run.summary, everything=everything)
    ]
    rows = [{"run": str(run.folder.path), **row} for run in shown for row in cell_rows(run.summary)]
    summaries = [_facts(run) for run in shown]
    data = summaries[0] if len(summaries) == 1 else summaries
    print_tables(form, tables, rows, data)


def print_next(console: Console, folders: Sequence[Path], *, everything: bool = False) -> None:
    """Print the folders of runs, and commands for further steps."""
    words = shlex.join(map(str, folders))
    commands = [] if everything else [f"{program()} results {words} --all --explain"]
    if len(folders) > 1:
        commands.append(f"{program()} compare {words}")
    else:
        commands.append(f"{program()} report {words} --out {shlex.quote(f'{folders[0].resolve().name}.html')}")
    console.print(Text(f"In {', '.join(map(str, folders))}. Next:", style="dim"), soft_wrap=True)
    for command in commands:
        say(f"  {command}")


def _read(folder: Path) -> _Shown:
    run = RunFolder(folder)
    rows, failures = run.rows(), run.failures()
    return _Shown(run, list(rows), run_snapshot(run), summarize(rows, failures))


def _facts(run: _Shown) -> dict[str, Any]:
    now = run.snapshot
    counts = {name: getattr(now, name) for name in ("planned", "finished", "running", "paused")}
    figures = {"now": {name: getattr(now, name) for name in NOW}} if now.is_live else {}
    more = {"spending": now.spending.to_json(), "warnings": unplayed(run.rows, run.folder.first_reply)}
    facts = {"folder": str(run.folder.path), **counts, "failed_attempts": now.failed, **figures, **more}
    repeats = [repeats_json(each) for each in repeated(run.rows)]
    return {**facts, **summary_json(run.summary), **({"repeats": repeats} if repeats else {})}


def _show(console: Console, run: _Shown, *, everything: bool) -> None:
    now = run.snapshot
    counted = {"running": now.running, "paused by a cap": now.paused, "failed attempts": now.failed}
    others = "".join(f", {count} {what}" for what, count in counted.items() if count)
    say(f"{run.folder.path}: {now.finished} of {now.planned} episodes finished{others}\n")
    if now.is_live:
        say(f"Now: {now.describe()}.\n")
    for table in run_tables(run.rows, run.summary, everything=everything):
        print_table(console, table)
    lines = (*_without_episode(now), *spending_sentences(now.spending), *unplayed(run.rows, run.folder.first_reply))
    for line in lines:
        say(line)


def _without_episode(now: RunSnapshot) -> Iterator[str]:
    """Say which cells have no finished episode, and therefore no row in the tables."""
    cells = [", ".join(filter(None, (cell.game, cell.player, cell.given))) for cell in now.cells if not cell.finished]
    if cells:
        more = f"; and {len(cells) - NAMED} more" if len(cells) > NAMED else ""
        yield f"Without a finished episode: {'; '.join(cells[:NAMED])}{more}."
