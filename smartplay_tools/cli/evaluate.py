"""The command `eval`: a resumable run, with a table of results at its end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Annotated, Any, cast

import typer

from smartplay_tools.cli import options, runs
from smartplay_tools.cli.episode_options import RULES, EpisodeOptions, read_budget, with_episode_options
from smartplay_tools.cli.results import print_next, run_tables
from smartplay_tools.cli.show import print_json, print_table, table_console
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.analysis.decisions import Margin
from smartplay_tools.evaluation.analysis.gates import Gate, baseline_gates, junit as as_junit, mean_gates
from smartplay_tools.evaluation.analysis.pairs import RowCondition
from smartplay_tools.evaluation.analysis.summary import summarize
from smartplay_tools.evaluation.analysis.tables import plain, summary_json
from smartplay_tools.evaluation.run_folder.folder import RunFolder, Until
from smartplay_tools.evaluation.runs.plan import Plan, make_cells, plan_episodes, plan_suite
from smartplay_tools.evaluation.runs.players import PlayerConfig
from smartplay_tools.evaluation.runs.run_options import RunFile, read_run_file
from smartplay_tools.evaluation.runs.runner import Run
from smartplay_tools.evaluation.suites import get_suite, suite_games
from smartplay_tools.records.rows import unplayed
from smartplay_tools.terminal import say
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
    until: Annotated[
        str | None,
        typer.Option(metavar="decided", help="Stop when each cell's comparison with the first is decided."),
    ] = None,
    margin: Annotated[
        str | None,
        typer.Option(metavar="M", help="For --until and --baseline: the margin, in points or human scores (0.1h)."),
    ] = None,
    clip: Annotated[
        float | None, typer.Option(min=0, help="For --until: the largest difference, for games without score bounds.")
    ] = None,
    by: Annotated[str, typer.Option(help="For --until: score, or wins (which side of a pair scores more).")] = "score",
    fail_if: Annotated[
        list[str] | None,
        typer.Option(metavar="'score < X'", help="Fail if this holds for the mean of a cell; repeatable."),
    ] = None,
    baseline: Annotated[
        Path | None, typer.Option(help="A stored run: fail where this one is worse (with --margin).")
    ] = None,
    junit: Annotated[Path | None, typer.Option(help="Write these checks as JUnit XML.")] = None,
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
    end = _until(until, margin, clip, by, needs_margin=baseline is not None)
    conditions = list(map(RowCondition.parse, fail_if or []))
    kept = None if baseline is None else RunFolder(baseline).rows()
    done = run.play(_plan(asked, configs, episode, repeats), configs, run_file=text, until=end)
    if done is not None:
        judged = list(mean_gates(done.rows, conditions))
        if kept is not None and margin is not None:
            judged += baseline_gates(done.rows, kept, Margin.parse(margin))
        if junit is not None:
            junit.write_text(as_junit(judged, str(run.out)), encoding="utf-8", newline="\n")
        print_run(done, judged, as_json=run.as_json)


def _until(until: str | None, margin: str | None, clip: float | None, by: str, *, needs_margin: bool) -> Until | None:
    if needs_margin and margin is None:
        raise InvalidArgumentError("--baseline needs --margin M, the loss that does not matter.")
    if until is None:
        if clip is not None or (margin is not None and not needs_margin):
            raise InvalidArgumentError("--margin needs --until decided or --baseline; --clip needs --until decided.")
        return None
    if until != "decided" or margin is None:
        raise InvalidArgumentError("Write --until decided --margin M, where M is a difference that does not matter.")
    if by not in ("score", "wins"):
        raise InvalidArgumentError(f"--by is score or wins, not {by}.")
    Margin.parse(margin)
    return Until(margin, clip, cast(Any, by))


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


def print_run(run: Run, gates: Sequence[Gate] = (), *, as_json: bool) -> None:
    """Print the results of a run; the exit code is 0 only if all episodes are finished and played, and gates pass."""
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
        facts |= {"checks": plain(list(gates))} if gates else {}
        print_json({**facts, **summary_json(summary)})
    else:
        console = table_console()
        for table in run_tables(run.folder, run.rows, summary):
            print_table(console, table)
        print_next(console, [run.folder.path])
    runs.conclude(run, quiet=as_json)
    for gate in gates:
        if not gate.passed:
            say(f"Failed: {gate.game}, {gate.name}: {gate.message}", err=True)
    if not all(gate.passed for gate in gates):
        raise typer.Exit(1)
