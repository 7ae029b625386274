"""The command `replay`: verify a record."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from smartplay_tools.cli import options
from smartplay_tools.replay import replay as run_again


def replay(
    file: Annotated[Path, typer.Argument(help="A transcript.", show_default=False)], as_json: options.Json = False
) -> None:
    """Run a transcript again and compare it bit for bit; the exit code is 1 if anything differs.

    Example: smartplay-tools replay run.jsonl
    """
    found = run_again(file)
    if as_json:
        print(json.dumps({**asdict(found), "result": found.result and found.result.model_dump()}, indent=2))
    elif found.identical:
        Console().print(f"[green]identical[/]: {found.events} events of {file}", highlight=False, soft_wrap=True)
    else:
        Console(stderr=True).print(f"[red]differs[/]: {found.differences[0]}", highlight=False, soft_wrap=True)
    if not found.identical:
        raise typer.Exit(1)
