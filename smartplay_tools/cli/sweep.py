"""The command `sweep`: the same episodes with every window of a grid, followed by tables and figures."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from smartplay_tools.cli import options, runs
from smartplay_tools.cli.episode_options import GRID, EpisodeOptions, listed, with_episode_options
from smartplay_tools.cli.estimate import print_estimate
from smartplay_tools.cli.results import print_next
from smartplay_tools.cli.show import print_table, table_console
from smartplay_tools.evaluation.analysis.window_tables import windows_table
from smartplay_tools.evaluation.runs import Caps, plan_episodes
from smartplay_tools.evaluation.runs.sweeps import AXES, Sweep, grid


def _listed(name: str, text: str) -> Any:
    return typer.Option(name, metavar="LIST", help=text, rich_help_panel=GRID)


@with_episode_options(vary=AXES)
def sweep(
    games: Annotated[str, _listed("--games", "Ids of settings.")],
    players: Annotated[str, _listed("--players", "Names of players.")] = "rule",
    out: runs.Out = Path("sweep"),
    trials: runs.Trials = None,
    seed: options.Seed = 0,
    base_url: options.BaseUrls = None,
    player_option: options.PlayerOptions = None,
    workers: runs.Workers = None,
    executor: runs.ExecutorName = None,
    shard: runs.Shard = None,
    run_tokens: runs.RunTokens = None,
    run_cost: runs.RunCost = None,
    price: runs.Prices = None,
    dry_run: runs.DryRun = False,
    assume_reply_tokens: runs.AssumeReplyTokens = None,
    quiet: runs.Quiet = False,
    as_json: options.Json = False,
    *,
    episode: EpisodeOptions,
) -> None:
    """Play a grid of context windows on the same seeds, and print what smaller windows cost and save.

    Example: smartplay-tools sweep --games BanditTwoArmedHighLowFixed-v0 --history 1,5,50 --trials 20 --out runs/sweep
    """
    configs = runs.player_configs(listed("--players", players), base_url, player_option)
    found = grid(
        listed("--games", games),
        configs,
        vary=episode.vary,
        engine=episode.engine,
        tokenizer=episode.tokenizer,
        options=episode.options,
        **episode.rules,
    )
    for reason in found.left_out:
        typer.echo(f"Left out: {reason}", err=True)
    plan = plan_episodes(found.cells, trials=trials, seed=seed)
    part, caps_of_run = runs.read_shard(shard), Caps(run_tokens, run_cost)
    if dry_run:
        print_estimate(
            plan if part is None else plan.shard(*part),
            runs.prices(price),
            configs,
            caps=caps_of_run,
            workers=workers,
            reply_tokens=assume_reply_tokens,
            as_json=as_json,
        )
        return
    run = runs.carry_out(
        plan,
        out,
        quiet=quiet or as_json,
        workers=workers,
        executor=executor,
        shard=part,
        caps=caps_of_run,
        prices=runs.prices(price),
        configs=configs,
    )
    _show(Sweep(run, found.left_out), as_json=as_json)
    runs.conclude(run, quiet=as_json)


def _show(sweep: Sweep, *, as_json: bool) -> None:
    """Write tables and figures, and print the summary."""
    written = sweep.write()
    if as_json:
        print(json.dumps(sweep.summary, indent=2))
        return
    console = table_console()
    print_table(console, windows_table(sweep.comparisons))
    folder = sweep.run.folder.path
    names = ", ".join(sorted({str(path.relative_to(folder).with_suffix("")) for path in written}))
    console.print(f"In {folder}: {names}.", highlight=False, markup=False, soft_wrap=True)
    if not any(path.suffix == ".parquet" for path in written):
        console.print("For Parquet and figures: pip install 'smartplay-tools[evaluation]'.", markup=False)
    print_next(console, [folder])
