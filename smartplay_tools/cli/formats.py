"""The output formats of tables: for a terminal, for a paper and for a program."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Annotated, Any

import typer

from smartplay_tools.cli.options import Format, for_a_program
from smartplay_tools.cli.show import print_json, print_table, table_console
from smartplay_tools.evaluation.analysis.formats import TextTable, rows_to_csv, to_latex, to_markdown
from smartplay_tools.streams import own_output

FormatOption = Annotated[Format, typer.Option("--format", help="Output format.", callback=for_a_program, is_eager=True)]


def print_tables(
    form: Format, tables: Iterable[TextTable], rows: Sequence[Mapping[str, Any]] = (), data: Any = None
) -> None:
    """Print tables in a format; CSV has the rows, in full precision, and JSON the data."""
    if form is Format.JSON:
        print_json(data)
    elif form is Format.CSV:
        print(rows_to_csv(rows), end="", file=own_output())
    elif form is Format.TEXT:
        console = table_console()
        for table in tables:
            print_table(console, table)
    elif form is Format.MARKDOWN:
        print("\n".join(map(to_markdown, tables)), end="", file=own_output())
    else:
        titles: Counter[str] = Counter()
        for table in tables:
            titles[table.title] += 1
            before = "\n" if titles.total() > 1 else ""
            print(before + to_latex(table, titles[table.title]), end="", file=own_output())
