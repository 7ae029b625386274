"""The command `cost`: what runs cost under the rules of caches."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, cast

import typer

from smartplay_tools.cli import options
from smartplay_tools.cli.formats import FormatOption, print_tables
from smartplay_tools.cli.options import Format
from smartplay_tools.cli.threads import print_thread_costs, thread_files
from smartplay_tools.costs.cached import PLACES, Place
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.analysis.money import CellCost, cell_costs, cost_rows, cost_tables
from smartplay_tools.evaluation.costs.tariffs import Tariff, charge_records, tariffs_of
from smartplay_tools.evaluation.run_folder.folder import RunFolder, read_each
from smartplay_tools.providers.prices import Price

Caches = Annotated[
    list[str] | None,
    typer.Option("--cache", metavar="RULE", help="The rule of a cache, or PROVIDER:MODEL for a model's; repeatable."),
]


def cost(
    folders: Annotated[
        list[Path],
        typer.Argument(metavar="DIR...", help="Folders of runs, or context records.", show_default=False),
    ],
    cache: Caches = None,
    marks: Annotated[
        str, typer.Option(help="Where prompts are marked, for rules that need it: stable, end, both or none.")
    ] = ",".join(PLACES),
    price: Annotated[
        str | None, typer.Option(metavar="IN,OUT[,CACHED[,WRITTEN]]", help="USD per million tokens, for all rules.")
    ] = None,
    tokenizer: options.Tokenizers = None,
    form: FormatOption = Format.TEXT,
    as_json: options.Json = False,
) -> None:
    """Show what runs would have cost under the rules of providers' caches, computed from their records.

    Example: smartplay-tools cost runs/sweep --cache anthropic-512 --cache openai:gpt-5.5
    """
    places = () if marks == "none" else tuple(options.names(marks))
    given = None if price is None else Price.parse(price)
    tariffs = tariffs_of(cache or [], price=given, marks=cast("tuple[Place, ...]", places))
    if files := thread_files(folders):
        print_thread_costs(files, tariffs, Format.JSON if as_json else form)
        return
    cells = read_costs(folders, tariffs)
    rows = cost_rows(cells, tariffs)
    print_tables(Format.JSON if as_json else form, cost_tables(cells, tariffs), rows, rows)


def read_costs(folders: Sequence[Path], tariffs: Sequence[Tariff]) -> list[CellCost]:
    """Return what the cells of runs cost; `InvalidArgumentError` if no cell's cost is known."""

    def of_run(folder: Path) -> list[CellCost]:
        run = RunFolder(folder)
        rows = run.rows()
        records = {row["key"]: run.transcript(row["key"]) for row in rows}
        charged = charge_records(records, tariffs)
        return cell_costs(rows, charged, run=str(folder) if len(folders) > 1 else "")

    cells = [cell for each in read_each(folders, of_run) for cell in each]
    if not cells:
        names = ", ".join(map(str, folders))
        raise InvalidArgumentError(
            f"{names} has no finished episode with prompts and usage on record, so nothing can be said about its cost."
        )
    return cells
