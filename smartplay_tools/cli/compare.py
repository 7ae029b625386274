"""The command `compare`, which compares runs and sweeps pair by pair."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from smartplay_tools.cli import options
from smartplay_tools.cli.formats import FormatOption, print_tables
from smartplay_tools.cli.options import Format
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.analysis.comparison import as_rows, compare as compare_runs
from smartplay_tools.evaluation.analysis.comparison_tables import comparison_tables
from smartplay_tools.evaluation.analysis.decisions import Margin
from smartplay_tools.evaluation.analysis.tables import plain
from smartplay_tools.evaluation.run_folder.folder import RunFolder, read_each
from smartplay_tools.records.rows import Row


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
    margin: Annotated[
        str | None,
        typer.Option(
            metavar="M", help="The difference that does not matter, in points or human scores (0.1h), for verdicts."
        ),
    ] = None,
    form: FormatOption = Format.TEXT,
    as_json: options.Json = False,
) -> None:
    """Compare runs pair by pair: differences with intervals, wins, ties and losses, tokens.

    Episodes of the same game, seed and trial are a pair. One run with several players or budgets can be compared with
    itself.

    Example: smartplay-tools compare runs/before runs/after --format latex
    """
    rows = _rows_by_run(folders)
    given = None if margin is None else Margin.parse(margin)
    compared = compare_runs(rows, reference=reference, margin=given)
    form = Format.JSON if as_json else form
    print_tables(form, comparison_tables(compared), as_rows(compared), plain(compared))


def _rows_by_run(folders: Sequence[Path]) -> dict[str, Sequence[Row]]:
    """Return the rows of runs by their folders, of which none may be named twice."""
    if len({folder.resolve() for folder in folders}) < len(folders):
        raise InvalidArgumentError("The same folder is named twice; name every run once.")
    return dict(read_each(folders, lambda folder: (str(folder), RunFolder(folder).rows())))
