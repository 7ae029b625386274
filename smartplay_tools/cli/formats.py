"""The output formats of tables: for a terminal, for a paper and for a program."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Annotated, Any

import typer

from smartplay_tools.cli.options import Format
from smartplay_tools.cli.show import print_table, table_console
from smartplay_tools.evaluation.analysis.formats import TextTable, to_latex, to_markdown

FormatOption = Annotated[Format, typer.Option("--format", help="Output format.")]


def print_tables(form: Format, tables: Iterable[TextTable], rows: Sequence[Mapping[str, Any]], data: Any) -> None:
    """Print tables in a format; CSV has the rows, in full precision, and JSON the data."""
    if form is Format.JSON:
        print(json.dumps(data, indent=2))
    elif form is Format.CSV:
        file = io.StringIO(newline="")
        writer = csv.DictWriter(file, list(rows[0]) if rows else [], lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
        print(file.getvalue(), end="")
    elif form is Format.TEXT:
        console = table_console()
        for table in tables:
            print_table(console, table)
    else:
        write = to_latex if form is Format.LATEX else to_markdown
        print("\n".join(map(write, tables)), end="")
