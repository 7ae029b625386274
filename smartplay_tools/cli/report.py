"""The command `report`, which writes the replay page of runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from smartplay_tools.cli import options
from smartplay_tools.terminal import say


def report(
    runs: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN...",
            help="A run folder, a folder of transcripts or one transcript; the first of several is the reference.",
            show_default=False,
        ),
    ],
    out: Annotated[Path, typer.Option(help="The HTML file to write; an existing one is replaced.")] = Path(
        "report.html"
    ),
    title: Annotated[str | None, typer.Option(help="The page's title; the run's name if not given.")] = None,
    plugins: options.Plugins = False,
    game: options.GameFiles = None,
    tokenizer: options.Tokenizers = None,
) -> None:
    """Write one self-contained HTML page that replays every episode of a run; it opens from disk, without a network.

    Of several runs, the page has their comparison.

    Example: smartplay-tools report runs/first --out first.html
    """
    # Reading records and drawing games needs imports that no other command needs.
    from smartplay_tools.evaluation.pages.report.page import write_report

    options.import_games(game)
    path = write_report(runs, out, title=title, plugins=plugins)
    size = path.stat().st_size / 1e6
    say(f"{path} ({size:.1f} MB): open it in a browser.")
