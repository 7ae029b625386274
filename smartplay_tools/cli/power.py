"""The command `power`: how many trials it takes to see a difference, estimated from existing runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from smartplay_tools.cli.compare import rows_by_run
from smartplay_tools.cli.formats import FormatOption, print_tables
from smartplay_tools.cli.options import Format
from smartplay_tools.evaluation.analysis.comparison import compare
from smartplay_tools.evaluation.analysis.decisions import Margin
from smartplay_tools.evaluation.analysis.planning import Planned, as_rows, plan_comparisons, planning_table
from smartplay_tools.evaluation.analysis.tables import plain


def power(
    folders: Annotated[
        list[Path],
        typer.Argument(metavar="DIR...", help="Folders of runs; the first is the reference.", show_default=False),
    ],
    difference: Annotated[
        str, typer.Option(metavar="D", help="The difference to detect, in points or human scores (0.1h).")
    ],
    reference: Annotated[
        str | None, typer.Option(help="Player of the first run that all others are compared with.", show_default=False)
    ] = None,
    form: FormatOption = Format.TEXT,
) -> None:
    """Say how many trials it takes to see a difference, from the spread of the pairs in these runs.

    Example: smartplay-tools power runs/before runs/after --difference 2
    """
    compared = compare(rows_by_run(folders), reference=reference)
    planned: list[Planned] = plan_comparisons(compared, Margin.parse(difference))
    print_tables(form, [planning_table(planned)], as_rows(planned), plain(planned))
