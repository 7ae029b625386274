"""The command `share`, which writes one episode, or some turns of it, as a small page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from smartplay_tools.cli import options
from smartplay_tools.errors import InvalidArgumentError


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
) -> None:
    """Write one episode, or some turns of it, as one small HTML page without lists, to send or to embed.

    Example: smartplay-tools share episode.jsonl --turns 20-40 --out lost.html
    """
    from smartplay_tools.evaluation.pages.report import write_excerpt

    path = write_excerpt(record, out, turns=None if turns is None else _range(turns), title=title, plugins=plugins)
    size = path.stat().st_size / 1e3
    Console().print(
        f"{path} ({size:.0f} kB): open it in a browser, send it, or embed it.", highlight=False, soft_wrap=True
    )


def _range(text: str) -> tuple[int, int]:
    first, _, last = text.partition("-")
    if not (first.isdecimal() and (last or first).isdecimal()):
        raise InvalidArgumentError(f"--turns is a turn or a range of turns such as 20-40, not {text!r}.")
    return int(first), int(last or first)
