"""The commands `submit ...`: a run as a file that proves itself; and `board`: a static leaderboard of such files."""

from __future__ import annotations

import datetime
import json
import os
import shlex
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from smartplay_tools.cli import options, program
from smartplay_tools.errors import InvalidArgumentError

app = typer.Typer(no_args_is_help=True)


@app.command(no_args_is_help=True)
def prepare(
    run: Annotated[Path, typer.Argument(help="The run's folder.", show_default=False)],
    name: Annotated[str, typer.Option(help="What the agent or model is called (model_name).", show_default=False)],
    out: Annotated[Path, typer.Option("--out", "-o", help="The new .zip file.")] = Path("bundle.zip"),
    player: Annotated[str | None, typer.Option(help="The player to submit, if the run has several.")] = None,
    model_organization: Annotated[str, typer.Option(help="Who made the model.")] = "not given",
    submitting_organization: Annotated[str, typer.Option(help="Who submits.")] = "not given",
    kind: Annotated[
        Literal["standard", "custom"],
        typer.Option("--type", help="standard: a fixed suite followed in everything; custom: any other run."),
    ] = "standard",
    suite: Annotated[
        str | None, typer.Option(help="The suite that was played; tools-v1 for a standard submission.")
    ] = None,
    notes: Annotated[str | None, typer.Option(help="How the run was made, in your words.")] = None,
    date: Annotated[str | None, typer.Option(help="The day of the submission, YYYY-MM-DD; by default today.")] = None,
    metadata: Annotated[
        Path | None, typer.Option(help="A JSON file with fields of submission.json; options override it.")
    ] = None,
) -> None:
    """Write a bundle: the records of a finished run, its rows and plan, versions, and metadata.

    The bundle holds everything that is on record, the base_url of a server included, and no credential.

    Example: smartplay-tools submit prepare runs/mine --name "My agent 1.0" --suite tools-v1 -o mine.zip
    """
    from smartplay_tools.evaluation.board.submissions.prepare import prepare_submission

    facts = _read_facts(metadata)
    if notes is not None:
        facts["methodology"] = {**facts.get("methodology", {}), "notes": notes}
    suite = suite or facts.get("suite") or ("tools-v1" if kind == "standard" else None)
    facts |= {"model_name": name, "submission_type": kind} | ({} if suite is None else {"suite": suite})
    facts.setdefault("model_organization", model_organization)
    facts.setdefault("submitting_organization", submitting_organization)
    facts["submission_date"] = date or facts.get("submission_date") or datetime.date.today().isoformat()
    submission = prepare_submission(run, out, facts, player=player)
    episodes = sum(result.episodes for result in submission.results)
    typer.echo(f"{out} ({out.stat().st_size / 1e6:.1f} MB): {episodes} episodes of {submission.model_name}. Next:")
    typer.echo(f"  {program()} submit check {shlex.quote(str(out))}")


def _read_facts(path: Path | None) -> dict[str, Any]:
    if path is None:
        return {}
    try:
        facts = json.loads(path.read_bytes())
    except OSError as error:
        raise InvalidArgumentError(f"{path} cannot be read: {error.strerror}.") from None
    except (ValueError, RecursionError):
        raise InvalidArgumentError(f"{path} is not JSON.") from None
    if not isinstance(facts, dict) or not isinstance(facts.get("methodology", {}), dict):
        raise InvalidArgumentError(f"{path} holds no fields of submission.json.")
    return facts


@app.command(no_args_is_help=True)
def check(
    bundle: Annotated[Path, typer.Argument(help="The .zip file of a submission.", show_default=False)],
    seeds: Annotated[
        Path | None, typer.Option(help="The board's file of issued seeds; the run's has to be among them.")
    ] = None,
    report: Annotated[Path | None, typer.Option(help="Write the report as JSON into this file, too.")] = None,
    workers: Annotated[int | None, typer.Option(min=1, help="Processes; by default one for each processor.")] = None,
    seconds: Annotated[float, typer.Option(min=1, help="Seconds that the check of one record may take.")] = 120,
    memory: Annotated[int, typer.Option(min=256, help="The most memory of a process in MB (not on Windows).")] = 4096,
    engine: Annotated[
        list[str] | None, typer.Option(help="An engine that may be started, such as luanti; repeatable.")
    ] = None,
    plugins: Annotated[bool, typer.Option("--plugins", help="Replay games of installed packages, too.")] = False,
    tokenizer: Annotated[str | None, typer.Option(help="The records' tokenizer, if it is not in this package.")] = None,
    as_json: options.Json = False,
) -> None:
    """Replay a submission and compute every row again; the exit code is 1 unless everything is verified.

    The bundle may come from a stranger: nothing that it names is imported, started or downloaded unless an option here
    allows it, and every record is checked under limits of time and memory.

    Example: smartplay-tools submit check mine.zip --seeds seeds.jsonl --report mine.json
    """
    from smartplay_tools.evaluation.board.submissions.bundle import Limits
    from smartplay_tools.evaluation.board.submissions.check import check_submission
    from smartplay_tools.evaluation.board.submissions.check_report import report_json, report_text
    from smartplay_tools.evaluation.board.submissions.submitted_plan import Allowed

    checked = check_submission(
        bundle,
        seeds=seeds,
        allowed=Allowed(tuple(engine or ()), plugins, tokenizer),
        workers=workers or os.cpu_count() or 1,
        limits=Limits(seconds=seconds, memory_bytes=memory << 20),
    )
    text = json.dumps(report_json(checked), indent=2)
    if report is not None:
        report.write_text(text + "\n", encoding="ascii", newline="\n")
    typer.echo(text if as_json else report_text(checked), nl=as_json)
    if not checked.verified:
        raise typer.Exit(1)


@app.command(no_args_is_help=True)
def seed(
    name: Annotated[str, typer.Option(help="The model_name of the submission.", show_default=False)],
    seeds: Annotated[Path, typer.Option(help="The board's file of issued seeds; a line is added.")] = Path(
        "seeds.jsonl"
    ),
    suite: Annotated[str | None, typer.Option(help="The suite that the seed is for.")] = None,
    as_json: options.Json = False,
) -> None:
    """Issue a seed for a run: the run's worlds follow from it, so its author cannot choose them. For boards.

    Example: smartplay-tools submit seed --name "My agent 1.0" --suite tools-v1
    """
    from smartplay_tools.evaluation.board.submissions.issued_seeds import issue_seed
    from smartplay_tools.evaluation.suites import get_suite

    if suite is not None:
        get_suite(suite)
    issued = issue_seed(seeds, name, suite=suite)
    if as_json:
        typer.echo(json.dumps(issued.model_dump()))
        return
    typer.echo(f"{issued.seed} is issued to {issued.name}, and added to {seeds}. The run:")
    typer.echo(f"  {program()} eval --suite {suite or 'SUITE'} --seed {issued.seed} --players PLAYER --out RUN")


def board(
    bundles: Annotated[Path, typer.Argument(help="A folder with the .zip files of submissions.", show_default=False)],
    out: Annotated[Path, typer.Option(help="The folder of the site.")] = Path("site"),
    title: Annotated[str, typer.Option(help="The page's title.")] = "Leaderboard",
    seeds: Annotated[Path | None, typer.Option(help="The board's file of issued seeds.")] = None,
    replays: Annotated[int, typer.Option(min=0, help="Episodes of each game and budget that can be watched.")] = 1,
    workers: Annotated[int | None, typer.Option(min=1, help="Processes; by default one for each processor.")] = None,
    seconds: Annotated[float, typer.Option(min=1, help="Seconds that the check of one record may take.")] = 120,
) -> None:
    """Check every submission in a folder and write a leaderboard as static pages.

    Scores come from replayed records alone. Submissions that are not verified are listed without a score, and the exit
    code is 1 if there are any.

    Example: smartplay-tools board bundles --out site
    """
    from smartplay_tools.evaluation.board.site import build_board
    from smartplay_tools.evaluation.board.submissions.bundle import Limits, printable
    from smartplay_tools.evaluation.board.submissions.check import Checked

    def say(checked: Checked) -> None:
        typer.echo(f"{printable(checked.bundle)}: {checked.verdict}")

    made = build_board(
        bundles,
        out,
        title=title,
        seeds=seeds,
        workers=workers or os.cpu_count() or 1,
        limits=Limits(seconds=seconds),
        replays=replays,
        on_checked=say,
    )
    typer.echo(f"{out / 'index.html'}: {len(made.checked) - len(made.refused)} of {len(made.checked)} submissions.")
    if made.refused:
        raise typer.Exit(1)
