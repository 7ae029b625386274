"""The command `export`: finished episodes as the data of other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from smartplay_tools.cli import options
from smartplay_tools.terminal import say


def export(
    run: Annotated[
        Path, typer.Argument(help="A run's folder, a folder of transcripts, or one transcript.", show_default=False)
    ],
    out: Annotated[Path, typer.Option(help="The new folder to write.", show_default=False)],
    format: Annotated[  # noqa: A002 - the option's name
        str, typer.Option(help="sft (a row for every reply) or sft-chains.")
    ] = "sft",
    games: Annotated[str | None, typer.Option(help="Only these settings, with commas.")] = None,
    players: Annotated[str | None, typer.Option(help="Only these players, with commas.")] = None,
    completed: Annotated[bool, typer.Option("--completed", help="Only completed games.")] = False,
    summaries: Annotated[
        bool, typer.Option("--summaries", help="Write rows for prompts for a summary, too (sft, sft-chains).")
    ] = False,
    tokenizer: options.Tokenizers = None,
) -> None:
    """Write finished episodes as training rows.

    Example: smartplay-tools export runs/first --format sft --completed --out data
    """
    # Reading many records takes imports that no other command needs.
    from smartplay_tools.evaluation.exports import export as write

    exported = write(
        run,
        out,
        format,
        summaries=summaries,
        games=options.names(games),
        players=options.names(players),
        completed=completed,
    )
    counted = ", ".join(f"{number:,} {name}" for name, number in exported.counts.items())
    say(f"{exported.folder}: {counted}")
    for reason, number in sorted(exported.left_out.items()):
        say(f"left out: {number:,} ({reason})")
