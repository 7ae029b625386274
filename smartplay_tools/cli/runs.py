"""The common parts of `eval`, `sweep` and `check`: a run's options, its players, playing it, and its exit code."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from smartplay_tools.cli import options
from smartplay_tools.cli.progress import showing
from smartplay_tools.cli.running import print_spending
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.runs import Caps, Plan, PlayerConfig, Run, player_of, run_plan
from smartplay_tools.evaluation.runs.progress import not_shown
from smartplay_tools.players import is_interactive, is_model
from smartplay_tools.records.prices import Price
from smartplay_tools.records.rows import unplayed

_RUN = "The run"

Out = Annotated[Path, typer.Option(help="The run's folder; if it holds this run already, it is resumed.")]
Trials = Annotated[
    int | None, typer.Option(min=1, help="Episodes per game, player and budget; the paper's number if not given.")
]
Workers = Annotated[int | None, typer.Option(min=1, help="Episodes at a time.", rich_help_panel=_RUN)]
ExecutorName = Annotated[
    str | None,
    typer.Option(
        "--executor", help="inline, processes, async or ray; chosen for each player if not given.", rich_help_panel=_RUN
    ),
]
Shard = Annotated[
    str | None,
    typer.Option(metavar="I/N", help="Play only part I of N; `merge` joins the parts.", rich_help_panel=_RUN),
]
RunTokens = Annotated[int | None, typer.Option(min=1, help="Cap on the whole run, in tokens.", rich_help_panel=_RUN)]
RunCost = Annotated[float | None, typer.Option(min=0, help="Cap on the whole run, in USD.", rich_help_panel=_RUN)]
Prices = Annotated[
    list[str] | None,
    typer.Option(
        "--price", metavar="PLAYER=IN,OUT[,CACHED]", help="USD per million tokens; repeatable.", rich_help_panel=_RUN
    ),
]
DryRun = Annotated[
    bool, typer.Option("--dry-run", help="Estimate calls, tokens, cost and hours; play nothing.", rich_help_panel=_RUN)
]
AssumeReplyTokens = Annotated[
    int | None, typer.Option(min=1, help="For --dry-run: assumed tokens of a model's reply.", rich_help_panel=_RUN)
]
Quiet = Annotated[bool, typer.Option("--quiet", help="Show no progress.", rich_help_panel=_RUN)]


def player_configs(
    names: Sequence[str], urls: Sequence[str] | None, pairs: Sequence[str] | None, known: Sequence[PlayerConfig] = ()
) -> list[PlayerConfig]:
    """Return the players of a run, from the run file or by name, with the options of the command line.

    An option is of one player as NAME.KEY=VALUE, else of all. A server is of one player as NAME=URL, else of every
    model (such as `openai:MODEL`).
    """
    players = [one for name in names for one in _named(name, known)]
    common: dict[str, Any] = {}
    own: dict[str, dict[str, Any]] = {}
    for pair in pairs or []:
        player = next((name for name in names if pair.startswith(f"{name}.")), None)
        if player is None:
            common |= options.key_values([pair], "--player-option")
        else:
            part = options.key_values([pair.removeprefix(f"{player}.")], "--player-option")
            own[player] = {**own.get(player, {}), **part}
    for url in urls or []:
        player = next((name for name in names if url.startswith(f"{name}=")), None)
        if player is None and not any(map(is_model, names)):
            raise InvalidArgumentError(
                f"--base-url {url} applies to no player of this run; models have names such as openai:MODEL."
            )
        for name in [player] if player else list(filter(is_model, names)):
            own[name] = {"base_url": url.removeprefix(f"{player}=") if player else url, **own.get(name, {})}
    return [one.model_copy(update={"options": {**common, **one.options, **own.get(one.name, {})}}) for one in players]


def _named(name: str, known: Sequence[PlayerConfig]) -> list[PlayerConfig]:
    return [one for one in known if one.name == name] or [PlayerConfig(name=name)]


def carry_out(plan: Plan, out: Path, *, quiet: bool, shard: tuple[int, int] | None, caps: Caps, **how: Any) -> Run:
    """Play a plan, with its progress on standard error."""
    # A person plays on the terminal on which the progress would be shown.
    quiet = quiet or any(is_interactive(player_of(cell)) for cell in plan.cells)
    display = not_shown if quiet else partial(showing, Console(stderr=True))
    return run_plan(plan, out, shard=shard, caps=caps, display=display, **how)


def conclude(run: Run, *, quiet: bool = False) -> None:
    """Print what a run has used and what is unfinished; exit with 1 unless every episode is finished and was played."""
    console = Console(stderr=True)

    def say(text: str) -> None:
        console.print(text, soft_wrap=True, highlight=False, markup=False)

    left = f"{run.planned - len(run.rows)} of {run.planned} episodes are not finished"
    if not quiet:
        print_spending(console, run.spending)
    if run.refused is not None:
        say(f"{run.refused} Correct the key, the model's name or --base-url; the same command then continues the run.")
    elif run.stopped is not None:
        say(f"Stopped by {run.stopped}. The same command continues the run.")
    elif run.cap_reached:
        paused = f", {run.status.paused} of them paused" if run.status.paused else ""
        say(f"A cap of the run is reached: {left}{paused}. The same command with a higher cap continues the run.")
    elif not run.complete:
        say(f"{left}; {run.folder.path / 'attempts'} has their records. The same command retries them.")
    warnings = unplayed(run.rows)
    for warning in warnings:
        say(warning)
    if warnings or not run.complete:
        raise typer.Exit(1)


def prices(pairs: list[str] | None) -> dict[str, Price]:
    """Return the prices of PLAYER=IN,OUT pairs."""
    found = {}
    for pair in pairs or []:
        player, equals, numbers = pair.rpartition("=")
        if not equals:
            raise InvalidArgumentError(f"--price {pair} names no player; write it as PLAYER=INPUT,OUTPUT.")
        found[player] = Price.parse(numbers)
    return found


def read_shard(text: str | None) -> tuple[int, int] | None:
    """Return the numbers of "I/N"."""
    if text is None:
        return None
    number, _, count = text.partition("/")
    if not (number.isdigit() and count.isdigit()):
        raise InvalidArgumentError(f"--shard {text} is invalid; write it as 1/4.")
    return int(number), int(count)
