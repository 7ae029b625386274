"""The command `check`: three turns with each model of a run, before the run.

The checks of `doctor`: they find out which parts of this package work on this machine by using them.

There are four kinds of parts. The core has to work everywhere. Engines are programs behind a game, of which the
default is part of the core. Extras are optional dependencies; their requirements are read from the metadata of the
installed package, and the modules that meet them are imported in a separate process, so that a library that crashes or
hangs does no harm. Models are files that the extra `local` plays; one that is here is loaded and timed, in a process of
its own, too.
"""

from __future__ import annotations

import contextlib
import json
import os
import platform
import subprocess
import sys
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from importlib import metadata
from importlib.util import find_spec
from inspect import getmodulename
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Literal

import typer
from packaging.requirements import Requirement
from rich.console import Console
from rich.markup import escape
from smartplay_local.model_files import KNOWN_MODELS, KnownModel, read_gguf

from smartplay_tools.cli import options, runs
from smartplay_tools.cli.show import compact_table
from smartplay_tools.context import tokens
from smartplay_tools.errors import InvalidArgumentError, SmartPlayError
from smartplay_tools.evaluation.quantities import megabytes
from smartplay_tools.evaluation.runs.players import PlayerConfig, check_prices, given_prices
from smartplay_tools.evaluation.runs.probe import Probe, probe
from smartplay_tools.evaluation.runs.run_options import RunFile, read_run_file
from smartplay_tools.games.minecraft.engines import check_engines
from smartplay_tools.games.specs import GAMES


def check(
    run_file: Annotated[
        Path | None, typer.Argument(metavar="[RUN.toml]", help="A run file, whose players are checked.")
    ] = None,
    players: Annotated[str | None, typer.Option(help="Comma-separated names of players.")] = None,
    base_url: options.BaseUrls = None,
    player_option: options.PlayerOptions = None,
    price: runs.Prices = None,
    parse_calls: options.ParseCalls = None,
    tool_choice: options.ToolChoice = None,
    as_json: options.Json = False,
) -> None:
    """Play three turns with every model of a run, and print whether it can be reached, plays and reports usage.

    The exit code is 1 if a model cannot play.

    Example: smartplay-tools check --players openai:gpt-5-mini
    """
    file = RunFile() if run_file is None else read_run_file(run_file)[0]
    names = options.names(players) or [config.name for config in file.configs()]
    if not names:
        raise InvalidArgumentError("Name players (--players openai:MODEL) or a run file.")
    configs = runs.player_configs(list(dict.fromkeys(names)), base_url, player_option, file.configs())
    configs = runs.with_tool_options(configs, parse_calls, tool_choice)
    check_prices(runs.prices(price), names)
    prices = given_prices(configs) | runs.prices(price)
    answers = [(config, probe(config, prices)) for config in configs]
    probes = [answer for _, answer in answers if answer is not None]
    if as_json:
        print(json.dumps([{**asdict(answer), "advice": answer.advice} for answer in probes], indent=2))
    else:
        _print(answers)
    if not all(answer.playable for answer in probes):
        raise typer.Exit(1)


def _print(answers: list[tuple[PlayerConfig, Probe | None]]) -> None:
    console = Console()
    table = compact_table(
        "player", "reached", "tools", "plays", "ids", "parallel", "usage", "reasoning", "price", folded=1
    )
    for config, answer in answers:
        if answer is None:
            table.add_row(escape(config.name), "no model", *[""] * 7)
            continue
        words = map(_word, (answer.reachable, answer.tools, answer.played, answer.ids, answer.parallel, answer.usage))
        reasoning = "" if answer.reasoning is None else str(answer.reasoning)
        table.add_row(escape(answer.player), *words, reasoning, "known" if answer.price else "unknown")
    console.print(table)
    for _, answer in answers:
        for line in answer.advice if answer is not None else []:
            typer.echo(line)
    costs = [answer.cost for _, answer in answers if answer is not None and answer.cost is not None]
    if costs:
        typer.echo(f"These calls have cost ${sum(costs):.4f}.")


def _word(answer: bool | None) -> str:
    return "" if answer is None else "yes" if answer else "[red]no[/]"


PACKAGE = "smartplay-tools"

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


Kind = Literal["core", "engine", "extra", "model"]

_MEASURE = """
import json, sys
from smartplay_tools.errors import SmartPlayError
try:
    from smartplay_local import measure
    print(json.dumps(measure(sys.argv[1])))
except SmartPlayError as error:
    sys.exit(str(error))
"""


@dataclass(frozen=True)
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


def check_all_engines() -> list[PartCheck]:
    """Make a world on every engine."""
    return [PartCheck("engine", check.engine, check.works, check.detail) for check in check_engines()]


def check_extras() -> list[PartCheck]:
    """Import the requirements of every extra, and its adapter."""
    extras = sorted(set(metadata.metadata(PACKAGE).get_all("Provides-Extra") or ()) - NOT_FEATURES)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(lambda extra: check_modules("extra", extra, requirements(extra)), extras))


def check_models() -> list[PartCheck]:
    """Load every known model that is here, and time it."""
    return [_check_model(model) for model in KNOWN_MODELS.values()]


def _check_model(model: KnownModel) -> PartCheck:
    if not model.is_here:
        remedy = f"not here; smartplay-tools model get {model.name} downloads {megabytes(model.bytes)}"
        return PartCheck("model", model.name, False, remedy)
    if not model.is_intact:
        return PartCheck("model", model.name, False, f"damaged; smartplay-tools model get {model.name}")
    file = read_gguf(model.path)
    memory = megabytes(file.memory(file.context_length))
    command = [sys.executable, "-W", "ignore", "-c", _MEASURE, str(model.path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        problem = (done.stderr.strip().splitlines() or [f"it ends with code {done.returncode}"])[-1]
        return PartCheck("model", model.name, False, problem)
    times = json.loads(done.stdout)
    speed = f"{times['read_per_second']:,.0f} tokens a second read, {times['written_per_second']:,.0f} written"
    detail = f"{speed}, loaded in {times['load_seconds']:.1f} s; about {memory} of memory"
    return PartCheck("model", model.name, True, detail)


def requirements(extra: str | None = None) -> list[Requirement]:
    """Return what the installed package needs on this machine: always or, if an extra is given, for that extra."""
    declared = [Requirement(line) for line in metadata.requires(PACKAGE) or []]
    return [need for need in declared if _applies(need, extra)]


def check_modules(kind: Kind, name: str, needed: list[Requirement]) -> PartCheck:
    """Compare the installed versions with these requirements, and import their modules in a separate process."""
    wrong = _missing(needed) or _broken([*_modules(needed), *_adapters(name)])
    if wrong:
        package = f"{PACKAGE}[{name}]" if kind == "extra" else PACKAGE
        return PartCheck(kind, name, False, f"{wrong}; pip install '{package}'")
    return PartCheck(kind, name, True, ", ".join(f"{need.name} {_version(need)}" for need in needed))


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
            detail = f"{spec.id}: {type(error).__name__}: {error}; pip install --force-reinstall {PACKAGE}"
            return PartCheck("core", "games", False, detail)
    return PartCheck("core", "games", True, f"{len(GAMES)} settings of {len(families)} games")


def _applies(need: Requirement, extra: str | None) -> bool:
    """Whether a requirement holds for the extra and not without it; for None, whether it always holds."""
    always = need.marker is None or need.marker.evaluate({"extra": ""})
    if extra is None or always:
        return extra is None and always
    return need.marker is not None and need.marker.evaluate({"extra": extra})


def _missing(needed: list[Requirement]) -> str:
    for need in needed:
        version = _version(need)
        if version is None:
            return f"{need.name} is not installed"
        if not need.specifier.contains(version, prereleases=True):
            return f"{need.name} is {version}, but {need.specifier} is needed"
    return ""


def _version(need: Requirement) -> str | None:
    try:
        return metadata.version(need.name)
    except metadata.PackageNotFoundError:
        return None


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


CHECKS: Mapping[Kind, Callable[[], list[PartCheck]]] = MappingProxyType(
    {"core": check_core, "engine": check_all_engines, "extra": check_extras, "model": check_models}
)
"""The check for each kind of part, in the order of the report."""
