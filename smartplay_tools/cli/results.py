"""The command `results`, which shows the results of runs, also of unfinished ones."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, cast

import typer
from rich.console import Console
from rich.text import Text

from smartplay_tools.cli import options
from smartplay_tools.cli.running import print_running, print_spending
from smartplay_tools.cli.show import print_table, table_console
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.analysis.details import details, failures_table
from smartplay_tools.evaluation.analysis.formats import Column, TextTable
from smartplay_tools.evaluation.analysis.headline import TERMS, headline
from smartplay_tools.evaluation.analysis.summary import RunSummary, summarize
from smartplay_tools.evaluation.analysis.tables import summary_json, write_csv, write_parquet
from smartplay_tools.records.rows import Row, unplayed
from smartplay_tools.records.run_folder import RunFolder
from smartplay_tools.records.snapshot import RunSnapshot, run_snapshot


@dataclass(frozen=True)
class _Shown:
    """The data of a run, read once."""

    folder: Path
    rows: list[Row]
    snapshot: RunSnapshot
    summary: RunSummary


def results(
    folders: Annotated[list[Path], typer.Argument(metavar="DIR...", help="Folders of runs.", show_default=False)],
    everything: Annotated[bool, typer.Option("--all", help="Show all tables, not only the first.")] = False,
    explain: Annotated[bool, typer.Option("--explain", help="Explain the terms in the tables.")] = False,
    as_json: options.Json = False,
    csv: Annotated[Path | None, typer.Option(help="Write a CSV file with a row for each episode.")] = None,
    parquet: Annotated[Path | None, typer.Option(help="Write the same as Parquet, with column types.")] = None,
    weights: Annotated[str, typer.Option(help="How capabilities are weighted: paper or zero-based.")] = "paper",
) -> None:
    """Show the scores of runs with intervals, tokens and cost; with --all also mistakes, ends and differences.

    Of a run in progress, the finished episodes are shown.

    Example: smartplay-tools results runs/first --all --csv first.csv
    """
    shown = [_read(folder, weights) for folder in folders]
    _write_files(shown, csv, parquet)
    if as_json:
        found = [{**_counts(run), **summary_json(run.summary)} for run in shown]
        print(json.dumps(found[0] if len(found) == 1 else found, indent=2))
        return
    console = table_console()
    for run in shown:
        _show(console, run, everything=everything)
    if explain:
        print_terms(console)
    print_next(console, folders, everything=everything)


def print_summary(console: Console, summary: RunSummary, *, everything: bool = False) -> None:
    """Print a run's headline and its failures, or all of its tables."""
    if summary.cells:
        print_table(console, headline(summary))
    if everything:
        for table in details(summary):
            print_table(console, table)
    elif summary.failures:
        print_table(console, failures_table(summary.failures))


def print_terms(console: Console) -> None:
    """Print the meaning of the terms in the tables."""
    rows = tuple(TERMS.items())
    print_table(
        console, TextTable("meaning of the terms", (Column("term", words=True), Column("meaning", words=True)), rows)
    )


def print_next(console: Console, folders: Sequence[Path], *, everything: bool = False) -> None:
    """Print the folders of runs, and commands for further steps."""
    names = " ".join(map(str, folders))
    commands = [] if everything else [f"smartplay-tools results {names} --all --explain"]
    if len(folders) > 1:
        commands.append(f"smartplay-tools compare {names}")
    else:
        commands.append(f"smartplay-tools report {names} --out {folders[0].resolve().name}.html")
    console.print(Text(f"In {names}. Next:", style="dim"), soft_wrap=True)
    for command in commands:
        console.print(Text(f"  {command}"), soft_wrap=True)


def _read(folder: Path, weights: str) -> _Shown:
    run = RunFolder(folder)
    rows, failures = run.rows(), run.failures()
    summary = summarize(rows, failures, weights=cast(Any, weights))
    return _Shown(folder, list(rows), run_snapshot(run), summary)


def _write_files(shown: Sequence[_Shown], csv: Path | None, parquet: Path | None) -> None:
    several = len(shown) > 1
    rows = [{"run": str(run.folder), **row} if several else row for run in shown for row in run.rows]
    try:
        if csv is not None:
            write_csv(rows, csv)
        if parquet is not None:
            write_parquet(rows, parquet)
    except OSError as error:
        raise InvalidArgumentError(f"{error.filename or csv or parquet} cannot be written: {error.strerror}.") from None


def _counts(run: _Shown) -> dict[str, Any]:
    now = run.snapshot
    counts = {name: getattr(now, name) for name in ("planned", "finished", "running", "paused")}
    figures = {"now": asdict(now.figures())} if now.is_live else {}
    more = {"spending": now.spending.to_json(), "warnings": unplayed(run.rows)}
    return {"folder": str(run.folder), **counts, "failed_attempts": now.failed, **figures, **more}


def _show(console: Console, run: _Shown, *, everything: bool) -> None:
    now = run.snapshot
    counted = {"running": now.running, "paused by a cap": now.paused, "failed attempts": now.failed}
    others = "".join(f", {count} {what}" for what, count in counted.items() if count)
    said = f"{run.folder}: {now.finished} of {now.planned} episodes finished{others}\n"
    console.print(said, highlight=False, markup=False, soft_wrap=True)
    if now.finished < now.planned:
        print_running(console, now)
    print_summary(console, run.summary, everything=everything)
    print_spending(console, now.spending)
    for warning in unplayed(run.rows):
        console.print(warning, highlight=False, markup=False, soft_wrap=True)
