"""The command `doctor`, which checks what works on this machine."""

from __future__ import annotations

import dataclasses
import json
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from smartplay_tools.cli import options
from smartplay_tools.cli.checkup import CHECKS, PartCheck
from smartplay_tools.errors import InvalidArgumentError

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
