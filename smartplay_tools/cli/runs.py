"""The common parts of `eval`, `sweep` and `check`: a run's options, its players, playing it, and its exit code."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

from smartplay_tools.cli import INTERRUPTED, options
from smartplay_tools.cli.estimate import print_estimate
from smartplay_tools.cli.progress import showing, spending_sentences
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.runs.plan import Plan, player_of
from smartplay_tools.evaluation.runs.players import PlayerConfig, check_prices, player_named
from smartplay_tools.evaluation.runs.run_options import RunOptions
from smartplay_tools.evaluation.runs.runner import Run, run_plan
from smartplay_tools.players import is_interactive, is_model
from smartplay_tools.providers.prices import Price
from smartplay_tools.records.rows import unplayed
from smartplay_tools.terminal import Console, say

_option = partial(typer.Option, rich_help_panel="The run")

Out = Annotated[Path, typer.Option(help="The run's folder; if it holds this run already, it is resumed.")]
RunTokens = Annotated[int | None, _option(min=1, help="Cap on the whole run, in tokens.")]
RunCost = Annotated[float | None, _option(min=0, help="Cap on the whole run, in USD.")]
Prices = Annotated[
    list[str] | None,
    _option("--price", metavar="PLAYER=IN,OUT[,CACHED[,WRITTEN]]", help="USD per million tokens; repeatable."),
]


def player_configs(names: Sequence[str], urls: Sequence[str] | None, pairs: Sequence[str] | None) -> list[PlayerConfig]:
    """Return the players of a run by their names, with the options of the command line.

    An option is of one player as NAME.KEY=VALUE, else of all. A server is of one player as NAME=URL, else of every
    model (such as `openai:MODEL`).
    """
    if not names:
        raise InvalidArgumentError("Name at least one player, as in --players openai:MODEL.")
    players = list(map(player_named, names))
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
    return [
        player.model_copy(update={"options": {**common, **player.options, **own.get(player.name, {})}})
        for player in players
    ]


@dataclass(frozen=True)
class RunCommand:
    """The options that `eval` and `sweep` have in common, as they were given."""

    out: Out
    trials: Annotated[
        int | None, typer.Option(min=1, help="Episodes per game, player and budget; the paper's number if not given.")
    ] = None
    seed: options.Seed = 0
    base_url: options.BaseUrls = None
    player_option: options.PlayerOptions = None
    workers: Annotated[int | None, _option(min=1, help="Episodes at a time.")] = None
    executor: Annotated[
        str | None, _option("--executor", help="inline, processes, async or ray; chosen for each player if not given.")
    ] = None
    shard: Annotated[str | None, _option(metavar="I/N", help="Play only part I of N; `merge` joins the parts.")] = None
    run_tokens: RunTokens = None
    run_cost: RunCost = None
    price: Prices = None
    dry_run: Annotated[bool, _option("--dry-run", help="Estimate calls, tokens and cost; play nothing.")] = False
    assume_reply_tokens: Annotated[
        int | None, _option(min=1, help="For --dry-run: assumed tokens of a model's reply.")
    ] = None
    quiet: Annotated[bool, _option("--quiet", help="Show no progress.")] = False
    as_json: options.Json = False

    def players(self, names: Sequence[str]) -> list[PlayerConfig]:
        """Return the players of the run (`player_configs`), of which there has to be one."""
        return player_configs(names, self.base_url, self.player_option)

    def play(self, plan: Plan, players: Sequence[PlayerConfig]) -> Run | None:
        """Play a plan, with its progress on standard error; a dry run prints its estimate instead and returns None."""
        how, _ = RunOptions.split(vars(self) | {"shard": read_shard(self.shard), "prices": prices(self.price)})
        if self.dry_run:
            check_prices(how.prices or (), map(player_of, plan.cells))
            print_estimate(plan, how, reply_tokens=self.assume_reply_tokens, as_json=self.as_json)
            return None
        # A person plays on the terminal on which the progress would be shown.
        quiet = self.quiet or self.as_json or any(is_interactive(player_of(cell)) for cell in plan.cells)
        display = None if quiet else partial(showing, Console(stderr=True))
        return run_plan(plan, self.out, players, how, display=display)


def with_run_options(*, out: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Add the options of a run to a command; the command's argument `run` gets their values as a `RunCommand`."""
    kinds = get_type_hints(RunCommand, include_extras=True)
    added = {field.name: (kinds[field.name], field.default) for field in fields(RunCommand)}
    return options.with_options("run", added | {"out": (kinds["out"], Path(out))}, lambda given: RunCommand(**given))


def conclude(run: Run, *, quiet: bool = False) -> None:
    """Print what a run has used and what is unfinished; exit with 1 unless every episode is finished and was played."""
    tell = partial(say, err=True)
    left = f"{run.planned - len(run.rows)} of {run.planned} episodes are not finished"
    for sentence in () if quiet else spending_sentences(run.spending):
        tell(sentence)
    if run.refused is not None:
        tell(f"{run.refused}. Once that is corrected, the same command continues the run.")
    elif run.stopped is not None:
        tell(f"Stopped by {run.stopped}. The same command continues the run.")
    elif run.cap_reached:
        paused = f", {run.status.paused} of them paused" if run.status.paused else ""
        tell(f"A cap of the run is reached: {left}{paused}. The same command with a higher cap continues the run.")
    elif not run.complete:
        tell(f"{left}; {run.folder.path / 'attempts'} has their records. The same command retries them.")
    if beginnings := run.folder.beginnings():
        count = beginnings.total()
        episodes = "1 episode began" if count == 1 else f"{count} episodes began"
        reasons = "; ".join(f"{reason} ({count})" for reason, count in beginnings.items())
        tell(f"{episodes} again instead of going on, and what was spent before is counted: {reasons}.")
    if run.waiting:
        tell(f"{run.waiting} of them wait for the trial before them in their chain, which has no result yet.")
    warnings = unplayed(run.rows, run.folder.first_reply)
    for warning in warnings:
        tell(warning)
    if warnings or not run.complete:
        raise typer.Exit(INTERRUPTED if run.stopped == "SIGINT" else 1)


def prices(pairs: list[str] | None) -> dict[str, Price]:
    """Return the prices of PLAYER=IN,OUT pairs."""
    given = {}
    for pair in pairs or []:
        player, equals, numbers = pair.rpartition("=")
        if not equals:
            raise InvalidArgumentError(f"--price {pair} names no player; write it as PLAYER=INPUT,OUTPUT.")
        given[player] = Price.parse(numbers)
    return given


def read_shard(text: str | None) -> tuple[int, int] | None:
    """Return the numbers of "I/N"."""
    if text is None:
        return None
    number, _, count = text.partition("/")
    if not (number.isdigit() and count.isdigit()):
        raise InvalidArgumentError(f"--shard {text} is invalid; write it as 1/4.")
    return int(number), int(count)
