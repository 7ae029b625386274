"""The command `board`: a static leaderboard from submissions."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer


def board(
    bundles: Annotated[Path, typer.Argument(help="A folder with the .zip files of submissions.", show_default=False)],
    out: Annotated[Path, typer.Option(help="The folder of the site.")] = Path("site"),
    title: Annotated[str, typer.Option(help="The page's title.")] = "Leaderboard",
    seeds: Annotated[Path | None, typer.Option(help="The board's file of issued seeds.")] = None,
    replays: Annotated[int, typer.Option(min=0, help="Episodes of each game and budget that can be watched.")] = 1,
    workers: Annotated[int | None, typer.Option(min=1, help="Processes; by default one for each processor.")] = None,
    seconds: Annotated[float, typer.Option(min=1, help="Seconds that the check of one record may take.")] = 120,
) -> None:
    """Check every submission in a folder and write a leaderboard as static pages.

    Scores come from replayed records alone. Submissions that are not verified are listed without a score, and the exit
    code is 1 if there are any.

    Example: smartplay-tools board bundles --out site
    """
    from smartplay_tools.evaluation.board import build_board
    from smartplay_tools.evaluation.board.submissions import Checked, Limits
    from smartplay_tools.evaluation.board.submissions.findings import printable

    def say(checked: Checked) -> None:
        typer.echo(f"{printable(checked.bundle)}: {checked.verdict}")

    made = build_board(
        bundles,
        out,
        title=title,
        seeds=seeds,
        workers=workers or os.cpu_count() or 1,
        limits=Limits(seconds=seconds),
        replays=replays,
        on_checked=say,
    )
    typer.echo(f"{out / 'index.html'}: {len(made.checked) - len(made.refused)} of {len(made.checked)} submissions.")
    if made.refused:
        raise typer.Exit(1)
