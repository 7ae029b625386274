"""The commands `report`, which writes the replay page of runs, and `share`, which writes one episode or some turns."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from smartplay_tools.cli import options
from smartplay_tools.errors import InvalidArgumentError
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
    episodes: Annotated[
        str | None,
        typer.Option(
            help="The episodes that the page holds: a number, mistakes, failed, keys or all; for very large runs."
        ),
    ] = None,
    plugins: options.Plugins = False,
    game: options.GameFiles = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes that read records, where there are many.")
    ] = None,
    tokenizer: options.Tokenizers = None,
) -> None:
    """Write one self-contained HTML page that replays every episode of a run; it opens from disk, without a network.

    Of several runs, the page has their comparison and shows pairs of episodes side by side.

    Example: smartplay-tools report runs/first --out first.html
    """
    # Reading records and drawing games needs imports that no other command needs.
    from smartplay_tools.evaluation.pages.report.page import write_report

    options.import_games(game)
    processes = workers or os.cpu_count() or 1
    path = write_report(runs, out, title=title, episodes=episodes, plugins=plugins, workers=processes)
    size = path.stat().st_size / 1e6
    say(f"{path} ({size:.1f} MB): open it in a browser.")


def share(
    record: Annotated[Path, typer.Argument(metavar="EPISODE", help="The record of an episode.", show_default=False)],
    out: Annotated[Path, typer.Option(help="The HTML file to write; an existing one is replaced.")] = Path(
        "share.html"
    ),
    turns: Annotated[
        str | None, typer.Option(metavar="FIRST-LAST", help="The turns that the page plays; all if not given.")
    ] = None,
    title: Annotated[str | None, typer.Option(help="The page's title; the record's name if not given.")] = None,
    plugins: options.Plugins = False,
    game: options.GameFiles = None,
) -> None:
    """Write one episode, or some turns of it, as one small HTML page without lists, to send or to embed.

    Example: smartplay-tools share episode.jsonl --turns 20-40 --out lost.html
    """
    from smartplay_tools.evaluation.pages.report.page import write_excerpt

    if out.suffix != ".html":
        raise InvalidArgumentError(f"The name of what is shared ends in .html, unlike {out}.")
    options.import_games(game)
    span = None if turns is None else _range(turns)
    path = write_excerpt(record, out, turns=span, title=title, plugins=plugins)
    size = path.stat().st_size / 1e3
    say(f"{path} ({size:.0f} kB): open it in a browser, send it, or embed it.")


def _range(text: str) -> tuple[int, int]:
    first, _, last = text.partition("-")
    if not (first.isdecimal() and (last or first).isdecimal()):
        raise InvalidArgumentError(f"--turns is a turn or a range of turns such as 20-40, not {text!r}.")
    return int(first), int(last or first)
