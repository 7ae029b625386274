"""The command `compare`, which compares runs and sweeps pair by pair."""

from __future__ import annotations

import csv
import io
import json
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from smartplay_tools.cli import options
from smartplay_tools.cli.show import print_table, table_console
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.analysis.comparison import Comparison, as_rows
from smartplay_tools.evaluation.analysis.comparison import compare as compare_runs
from smartplay_tools.evaluation.analysis.comparison_tables import comparison_tables
from smartplay_tools.evaluation.analysis.formats import to_latex, to_markdown
from smartplay_tools.evaluation.analysis.tables import plain
from smartplay_tools.records.run_folder import RunFolder


class Format(StrEnum):
    """The output formats of a comparison."""

    TEXT = "text"
    MARKDOWN = "markdown"
    LATEX = "latex"
    CSV = "csv"
    JSON = "json"


def compare(
    folders: Annotated[
        list[Path],
        typer.Argument(
            metavar="DIR...", help="Folders of runs or sweeps; the first is the reference.", show_default=False
        ),
    ],
    reference: Annotated[
        str | None, typer.Option(help="Player of the first run that all others are compared with.", show_default=False)
    ] = None,
    form: Annotated[Format, typer.Option("--format", help="Output format.")] = Format.TEXT,
    as_json: options.Json = False,
) -> None:
    """Compare runs pair by pair: differences with intervals, wins, ties and losses, tokens.

    Episodes of the same game, seed and trial are a pair. One run with several players or budgets can be compared with
    itself.

    Example: smartplay-tools compare runs/before runs/after --format latex
    """
    names = [str(folder) for folder in folders]
    if len(set(names)) < len(names):
        raise InvalidArgumentError("The same folder is named twice; name every run once.")
    rows = {name: RunFolder(folder).rows() for name, folder in zip(names, folders, strict=True)}
    found = compare_runs(rows, reference=reference)
    if as_json or form is Format.JSON:
        print(json.dumps(plain(found), indent=2))
    elif form is Format.CSV:
        print(_csv(found), end="")
    elif form is Format.TEXT:
        console = table_console()
        for table in comparison_tables(found):
            print_table(console, table)
    else:
        write = to_latex if form is Format.LATEX else to_markdown
        print("\n".join(map(write, comparison_tables(found))), end="")


def _csv(found: Comparison) -> str:
    """CSV with a line of numbers for every pairing."""
    rows: list[dict[str, Any]] = as_rows(found)
    file = io.StringIO(newline="")
    writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return file.getvalue()
