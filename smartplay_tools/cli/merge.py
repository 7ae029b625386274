"""The command `merge`, which merges the shards of a run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from smartplay_tools.evaluation.runs.merge import merge as merge_parts


def merge(
    parts: Annotated[list[Path], typer.Argument(help="Folders of the run's shards.", show_default=False)],
    out: Annotated[Path, typer.Option(help="The new folder for the whole run.")],
) -> None:
    """Merge the shards of a run.

    It exits with code 1 if planned episodes are missing.

    Example: smartplay-tools merge runs/part1 runs/part2 --out runs/whole
    """
    whole = merge_parts(parts, out)
    finished, planned = len(whole.rows()), len(whole.manifest().episodes)
    typer.echo(f"{out}: {finished} of {planned} episodes are finished.")
    if finished < planned:
        raise typer.Exit(1)
