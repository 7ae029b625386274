"""The commands `minedojo ...`, which set up the engine that is the real game."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer

from smartplay_tools.games.minecraft.minedojo.engine import INTERPRETER
from smartplay_tools.games.minecraft.minedojo.install import install as make_environment

app = typer.Typer(help="Set up MineDojo, the Minecraft engine of the paper.", no_args_is_help=True)


@app.command("install")
def install(
    venv: Annotated[Path, typer.Option(help="A new folder for the environment.", show_default=False)],
    python: Annotated[
        str | None, typer.Option(help="A Python 3.11; by default this one, or python3.11 on the path.")
    ] = None,
) -> None:
    """Make the environment in which MineDojo 0.1 runs, and print the line that sets the variable for this package.

    It takes about a minute and 400 MB. The game's client is not part of it: MineDojo builds it with Java 8 when it
    starts for the first time.

    Example: smartplay-tools minedojo install --venv ~/minedojo
    """
    interpreter = make_environment(venv.expanduser(), python, say=lambda step: typer.echo(f"{step} ...", err=True))
    print(f"export {INTERPRETER}={shlex.quote(str(interpreter))}")
