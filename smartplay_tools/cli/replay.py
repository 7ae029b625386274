"""The command `replay`, which verifies a record, or all records of a run."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import track

from smartplay_tools.cli import options
from smartplay_tools.cli.show import print_json
from smartplay_tools.cli.threads import replayed_threads, thread_files
from smartplay_tools.errors import InvalidArgumentError, SmartPlayError, TranscriptError
from smartplay_tools.evaluation.run_folder.folder import RunFolder
from smartplay_tools.evaluation.run_folder.follower import run_snapshot
from smartplay_tools.evaluation.runs.audit import EpisodeAudit, audit, check_tokenizers, import_named, is_called_again
from smartplay_tools.records.record import Record
from smartplay_tools.records.replays import replay_record
from smartplay_tools.terminal import Console, Text

DIFFERS, NOT_REPLAYED = 1, 3
"""The exit codes; the first is that of a run in which some episodes differ and some were not replayed, too."""

SHOWN_DIFFERENCES = 3
"""The most differences printed per episode; the first matters, the others mostly follow from it."""


def replay(
    path: Annotated[Path, typer.Argument(help="A transcript, a run's folder, or context records.", show_default=False)],
    workers: Annotated[int | None, typer.Option(min=1, help="Episodes of a run at a time.")] = None,
    tokenizer: options.Tokenizers = None,
    strategy: Annotated[
        list[str] | None,
        typer.Option(
            help="A strategy that records name, if it is in a file: PATH/FILE.py:CLASS; repeatable. "
            "A compactor is called again, with the recorded replies."
        ),
    ] = None,
    game: options.GameFiles = None,
    as_json: options.Json = False,
) -> None:
    """Play records again and compare them bit for bit.

    The exit code is 1 if anything differs or is incomplete, and 3 if nothing does, but something was not replayed: its
    game, strategy or tokenizer was not named, or its engine or package is not here. What is named is known by its
    content, so a file may have been moved.

    Every finished episode of a run is replayed. An episode that is planned and has no row is missing, whether it is
    paused, running, not begun, or lost. Of a context
    manager's record every prompt is rebuilt and compared by its digest.

    Example: smartplay-tools replay run.jsonl
    """
    if files := thread_files([path]):
        raise typer.Exit(_replay_threads(path, files, as_json=as_json))
    games, strategies = game or [], strategy or []
    if games or strategies or tokenizer:
        cells = RunFolder(path).manifest().cells if path.is_dir() else [Record.head(path).config]
        import_named(games, strategies, cells)
        check_tokenizers(tokenizer or (), cells)
    if path.is_dir():
        code = _replay_run(path, workers, games, strategies, as_json=as_json)
    else:
        code = _replay_file(path, strategies, as_json=as_json)
    raise typer.Exit(code)


def _replay_threads(path: Path, files: Sequence[Path], *, as_json: bool) -> int:
    """Rebuild the prompts of a context manager."""
    identical, differences = replayed_threads(path, files, as_json=as_json)
    if not as_json:
        for sentence in identical:
            _say("identical", "green", f": {sentence}")
        for difference in differences[:SHOWN_DIFFERENCES]:
            _say("differs", "red", f": {difference}", stderr=True)
    return DIFFERS if differences else 0


def _replay_file(path: Path, strategies: Sequence[str], *, as_json: bool) -> int:
    record = Record.read(path, checks_fields=False)
    try:
        replayed = replay_record(record, calls_compactor=is_called_again(record.config, strategies))
    except TranscriptError:
        raise
    except SmartPlayError as error:
        _say(f"not replayed: {error}", stderr=True)
        return NOT_REPLAYED
    if as_json:
        print_json({**asdict(replayed), "result": replayed.result and replayed.result.model_dump()})
    elif replayed.identical:
        resumed = f", resumed at event {', '.join(map(str, replayed.resumed))}" if replayed.resumed else ""
        _say("identical", "green", f": {replayed.events} events of {path}{resumed}")
    elif not replayed.differences:
        what = f"the {replayed.events} events of {path} are identical, but its end is missing"
        _say("incomplete", "yellow", f": {what}", stderr=True)
    else:
        _say("differs", "red", f": {replayed.differences[0]}", stderr=True)
    if not as_json and replayed.not_compared is not None:
        _say(replayed.not_compared)
    return 0 if replayed.identical else DIFFERS


def _replay_run(
    path: Path, workers: int | None, games: Sequence[str], strategies: Sequence[str], *, as_json: bool
) -> int:
    folder = RunFolder(path)
    rows = folder.rows()
    progress = Console(stderr=True, quiet=as_json or not Console(stderr=True).is_terminal)
    going = audit(folder, workers or os.cpu_count() or 1, games=games, strategies=strategies, rows=rows)
    shown = track(going, "replaying", len(rows), console=progress, transient=True, disable=progress.quiet)
    findings = sorted(shown, key=lambda finding: finding.key)
    if not findings:
        raise InvalidArgumentError(f"{path} has no planned episode, so there is nothing to replay.")
    if as_json:
        print_json([asdict(finding) for finding in findings])
    else:
        _print_findings(path, findings)
        for sentence in sorted({finding.not_compared for finding in findings if finding.not_compared is not None}):
            _say(sentence)
        now = run_snapshot(folder)
        if now.paused or now.running:
            _say(f"{now.paused} paused, {now.running} running; not replayed")
    if any(finding.differences for finding in findings):
        return DIFFERS
    return NOT_REPLAYED if any(finding.not_replayed for finding in findings) else 0


def _print_findings(path: Path, findings: Sequence[EpisodeAudit]) -> None:
    differing = [finding for finding in findings if finding.differences and finding.has_row]
    missing = [finding for finding in findings if not finding.has_row]
    left = [finding for finding in findings if finding.not_replayed is not None]
    total, same = len(findings), len(findings) - len(differing) - len(missing) - len(left)
    if same == total:
        _say("identical", "green", f": all {total} episodes of {path}")
    if differing:
        _say(f"{len(differing)} of {total} episodes differ", "red", stderr=True)
    if left:
        _say(f"{len(left)} of {total} episodes were not replayed", "yellow", f", {same} are identical", stderr=True)
        for sentence in sorted({f"{finding.game}: {finding.not_replayed}" for finding in left}):
            _say(sentence, stderr=True)
    if missing:
        _say(f"{same} of {total} planned episodes are identical; {len(missing)} have no row", "red", stderr=True)
    for finding in (*differing, *(finding for finding in missing if finding.has_record)):
        for difference in finding.differences[:SHOWN_DIFFERENCES]:
            _say(f"{finding.key} ({finding.game}): {difference}", stderr=True)


def _say(verdict: str, style: str = "", further: str = "", *, stderr: bool = False) -> None:
    """Print a sentence on one line, however long it is, with its beginning in a style."""
    Console(stderr=stderr).print(Text(verdict, style=style), Text(further), sep="", soft_wrap=True)
