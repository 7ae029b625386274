"""The command `eval`: a resumable run, with a table of results at its end."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import Annotated, Any

import typer

from smartplay_tools.cli import options, runs
from smartplay_tools.cli.episode_options import RULES, EpisodeOptions, read_budget, with_episode_options
from smartplay_tools.cli.results import print_next, run_tables
from smartplay_tools.cli.show import print_json, print_table, table_console
from smartplay_tools.evaluation.analysis.summary import summarize
from smartplay_tools.evaluation.analysis.tables import summary_json
from smartplay_tools.evaluation.runs.plan import Plan, make_cells, plan_episodes, plan_suite
from smartplay_tools.evaluation.runs.players import PlayerConfig
from smartplay_tools.evaluation.runs.run_options import RunFile, read_run_file
from smartplay_tools.evaluation.runs.runner import Run
from smartplay_tools.evaluation.suites import get_suite, suite_games
from smartplay_tools.records.rows import unplayed
from smartplay_tools.types import Budget


@with_episode_options(without=())
@runs.with_run_options(out="run")
def evaluate(
    context: typer.Context,
    run_file: Annotated[
        Path | None,
        typer.Argument(metavar="[RUN.toml]", help="A run file; the options below override it.", show_default=False),
    ] = None,
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
    file, text = (RunFile(), None) if run_file is None else read_run_file(run_file)
    asked = _OptionValues(context, file)
    shared = {field.name for field in fields(run)} & RunFile.model_fields.keys()
    run = replace(run, **{name: asked.value(name) for name in shared})
    names = asked.names("players", [config.name for config in file.configs()])
    configs = run.players(list(dict.fromkeys(names)), file.configs())
    done = run.play(_plan(asked, configs, episode, repeats), configs, run_file=text)
    if done is not None:
        print_run(done, as_json=run.as_json)


def _plan(asked: _OptionValues, configs: list[PlayerConfig], episode: EpisodeOptions, repeats: int) -> Plan:
    suite, game_options = asked.value("suite"), {**asked.file.options, **episode.options}
    if suite is not None and get_suite(suite).is_fixed:
        given = asked.beside_suite() | ({"options"} if game_options else set())
        return plan_suite(get_suite(suite), configs, seed=asked.value("seed"), given=given)
    ids = suite_games(suite, asked.names("games", asked.file.games))
    rules = {name: asked.value(name) for name in ("engine", "tokenizer", *episode.rules)}
    cells = make_cells(ids, configs, asked.budgets(), **rules, options=game_options)
    return plan_episodes(cells, trials=asked.value("trials"), seed=asked.value("seed"), repeats=repeats)


class _OptionValues:
    """The value of each option: from the command line, else from the run file, else the default."""

    def __init__(self, context: typer.Context, file: RunFile) -> None:
        self.file, self._values, self._given = file, context.params, options.on_command_line(context)

    def value(self, name: str) -> Any:
        from_file = self.file.rules.get(name) if name in RULES else getattr(self.file, name)
        return self._values[name] if name in self._given or from_file is None else from_file

    def names(self, name: str, from_file: list[str]) -> list[str]:
        return from_file if from_file and name not in self._given else options.names(self._values[name])

    def beside_suite(self) -> set[str]:
        """Return the options that are given in addition to a suite, those of the budget by their common name."""
        given = self._given | {name for name in self.file.model_fields_set if getattr(self.file, name)}
        given |= self.file.rules.keys()
        return given | ({"budgets"} if given & set(Budget.model_fields) else set())

    def budgets(self) -> list[Budget]:
        fields = {name: self._values[name] for name in Budget.model_fields if name in self._given}
        given = read_budget(**fields)
        changed = {name: getattr(given, name) for name in fields}
        return [Budget(**{**dict(budget), **changed}) for budget in self.file.budgets or [Budget()]]


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
