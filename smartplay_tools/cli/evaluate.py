"""The command `eval`: a resumable run, with a table of results at its end."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from smartplay_tools.cli import options, runs
from smartplay_tools.cli.episode_options import RULES, EpisodeOptions, read_budget, with_episode_options
from smartplay_tools.cli.estimate import print_estimate
from smartplay_tools.cli.results import print_next, print_summary
from smartplay_tools.cli.show import table_console
from smartplay_tools.evaluation.analysis.summary import summarize
from smartplay_tools.evaluation.analysis.tables import summary_json
from smartplay_tools.evaluation.runs import Caps, Plan, PlayerConfig, Run, make_cells, plan_episodes, plan_suite
from smartplay_tools.evaluation.runs.run_file import RunFile, read_run_file
from smartplay_tools.evaluation.suites import get_suite, suite_games
from smartplay_tools.records.rows import unplayed
from smartplay_tools.types import Budget


@with_episode_options()
def evaluate(
    context: typer.Context,
    run_file: Annotated[
        Path | None,
        typer.Argument(metavar="[RUN.toml]", help="A run file; the options below override it.", show_default=False),
    ] = None,
    games: Annotated[str | None, typer.Option(help="Comma-separated ids of settings.")] = None,
    suite: Annotated[str | None, typer.Option(help="paper (the seven settings of its tables), or tools-v1.")] = None,
    players: Annotated[str, typer.Option(help="Comma-separated names of players.")] = "rule",
    out: runs.Out = Path("run"),
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
    """Play several trials of games with players, and print the results. The same command again resumes the run.

    Example: smartplay-tools eval --suite paper --players rule,random --trials 5 --out runs/paper
    """
    file, text = (RunFile(), None) if run_file is None else read_run_file(run_file)
    asked = _Asked(context, file)
    names = asked.names("players", [one.name for one in file.configs()])
    configs = runs.player_configs(list(dict.fromkeys(names)), base_url, player_option, file.configs())
    plan = _plan(asked, configs, episode)
    part = runs.read_shard(shard)
    caps = Caps(asked.value("run_tokens"), asked.value("run_cost"))
    given = runs.prices(price)
    if dry_run:
        print_estimate(
            plan if part is None else plan.shard(*part),
            given,
            configs,
            caps=caps,
            workers=asked.value("workers"),
            reply_tokens=assume_reply_tokens,
            as_json=as_json,
        )
        return
    run = runs.carry_out(
        plan,
        asked.value("out"),
        quiet=quiet or as_json,
        workers=asked.value("workers"),
        executor=asked.value("executor"),
        shard=part,
        caps=caps,
        prices=given,
        configs=configs,
        run_file=text,
    )
    print_run(run, as_json=as_json)


def _plan(asked: _Asked, configs: list[PlayerConfig], episode: EpisodeOptions) -> Plan:
    suite, game_options = asked.value("suite"), {**asked.file.options, **episode.options}
    if suite is not None and get_suite(suite).is_fixed:
        given = asked.beside_suite() | ({"options"} if game_options else set())
        return plan_suite(get_suite(suite), configs, seed=asked.value("seed"), given=given)
    ids = suite_games(suite, asked.names("games", asked.file.games))
    rules = {name: asked.value(name) for name in ("engine", "tokenizer", *episode.rules)}
    cells = make_cells(ids, configs, asked.budgets(), **rules, options=game_options)
    return plan_episodes(cells, trials=asked.value("trials"), seed=asked.value("seed"))


class _Asked:
    """The value of each option: from the command line, else from the run file, else the default."""

    def __init__(self, context: typer.Context, file: RunFile) -> None:
        self.file, self._values = file, context.params
        self._given = {
            name
            for name in context.params
            if (source := context.get_parameter_source(name)) is not None and source.name == "COMMANDLINE"
        }

    def value(self, name: str) -> Any:
        from_file = self.file.rules.get(name) if name in RULES else getattr(self.file, name)
        return self._values[name] if name in self._given or from_file is None else from_file

    def names(self, name: str, from_file: list[str]) -> list[str]:
        return from_file if from_file and name not in self._given else options.names(self._values[name])

    def beside_suite(self) -> set[str]:
        """Return what is asked for in addition to a suite, budgets by their common name."""
        given = self._given | {name for name in self.file.model_fields_set if getattr(self.file, name)}
        given |= self.file.rules.keys()
        return given | ({"budgets"} if given & set(Budget.model_fields) else set())

    def budgets(self) -> list[Budget]:
        fields = {name: self._values[name] for name in Budget.model_fields if name in self._given}
        given = read_budget(**fields)
        changed = {name: getattr(given, name) for name in fields}
        return [Budget(**{**one.model_dump(), **changed}) for one in self.file.budgets or [Budget()]]


def print_run(run: Run, *, as_json: bool) -> None:
    """Print the results of a run; the exit code is 0 only if every planned episode is finished and was played."""
    summary = summarize(run.rows, run.failures)
    if as_json:
        facts: dict[str, Any] = {
            "planned": run.planned,
            "finished": len(run.rows),
            "stopped": run.stopped,
            "refused": run.refused,
        }
        facts |= {"paused": run.status.paused, "spending": run.spending.to_json(), "warnings": unplayed(run.rows)}
        print(json.dumps({**facts, **summary_json(summary)}, indent=2))
    else:
        console = table_console()
        print_summary(console, summary)
        print_next(console, [run.folder.path])
    runs.conclude(run, quiet=as_json)
