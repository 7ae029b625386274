"""The command `eval`: a resumable run, with a table of results at its end."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from smartplay_tools.cli import options, runs
from smartplay_tools.cli.episode_options import EpisodeOptions, with_episode_options
from smartplay_tools.cli.results import print_next
from smartplay_tools.cli.show import print_json, print_table, table_console
from smartplay_tools.evaluation.analysis.run_tables import run_tables
from smartplay_tools.evaluation.analysis.summary import summarize
from smartplay_tools.evaluation.analysis.tables import summary_json
from smartplay_tools.evaluation.runs.plan import make_cells, plan_episodes, plan_suite
from smartplay_tools.evaluation.runs.runner import Run
from smartplay_tools.evaluation.suites import get_suite, suite_games
from smartplay_tools.records.rows import unplayed
from smartplay_tools.types import Budget


@with_episode_options(without=())
@runs.with_run_options(out="run")
def evaluate(
    context: typer.Context,
    games: Annotated[str | None, typer.Option(help="Comma-separated ids of settings.")] = None,
    suite: Annotated[str | None, typer.Option(help="paper (the seven settings of its tables), or tools-v1.")] = None,
    players: Annotated[
        str,
        typer.Option("--players", "--agent", help="Names of players, or FILE.py:FUNCTION of an agent; commas between."),
    ] = "rule",
    repeats: Annotated[int, typer.Option(min=1, help="How often each world is played, for players that sample.")] = 1,
    *,
    run: runs.RunCommand,
    episode: EpisodeOptions,
) -> None:
    """Play several trials of games with players, and print the results. The same command again resumes the run.

    Example: smartplay-tools eval --suite paper --players rule,random --trials 5 --out runs/paper
    """
    configs = run.players(list(dict.fromkeys(options.names(players))))
    if suite is not None and get_suite(suite).is_fixed:
        given = options.on_command_line(context)
        given |= {"budgets"} if given & set(Budget.model_fields) else set()
        given |= {"options"} if episode.options else set()
        plan = plan_suite(get_suite(suite), configs, seed=run.seed, given=given)
    else:
        ids = suite_games(suite, options.names(games))
        cells = make_cells(ids, configs, [episode.budget], **episode.of_cells)
        plan = plan_episodes(cells, trials=run.trials, seed=run.seed, repeats=repeats)
    done = run.play(plan, configs)
    if done is not None:
        print_run(done, as_json=run.as_json)


def print_run(run: Run, *, as_json: bool) -> None:
    """Print the results of a run; the exit code is 0 only if all episodes are finished and played."""
    summary = summarize(run.rows, run.failures)
    if as_json:
        facts: dict[str, Any] = {
            "planned": run.planned,
            "finished": len(run.rows),
            "stopped": run.stopped,
            "refused": run.refused,
            "began_again": run.folder.beginnings(),
        }
        facts |= {"paused": run.status.paused, "spending": run.spending.to_json()}
        facts["warnings"] = unplayed(run.rows, run.folder.first_reply)
        print_json({**facts, **summary_json(summary)})
    else:
        console = table_console()
        for table in run_tables(run.rows, summary):
            print_table(console, table)
        print_next(console, [run.folder.path])
    runs.conclude(run, quiet=as_json)
