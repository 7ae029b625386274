"""Preparing a submission: the part of a run that one player played, with its metadata, in one bundle."""

from __future__ import annotations

import json
import platform
from collections.abc import Iterator, Mapping
from dataclasses import replace
from importlib import metadata
from pathlib import Path
from typing import Any

from smartplay_tools.episode.stats import versions
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.board.submissions.bundle import write_bundle
from smartplay_tools.evaluation.board.submissions.metadata import Submission, read_submission
from smartplay_tools.evaluation.board.submissions.submitted_plan import cell_results, check_suite, read_plan
from smartplay_tools.evaluation.run_folder.folder import Manifest, RunFolder
from smartplay_tools.records.rows import Row

__all__ = ["prepare_submission"]


def prepare_submission(
    run: str | Path, out: str | Path, facts: Mapping[str, Any], *, player: str | None = None
) -> Submission:
    """Write a bundle of a run that is finished, and return its metadata.

    Arguments:
        run: the run's folder.
        out: the new zip file.
        facts: fields of `submission.json`; versions and results are filled in.
        player: whose episodes are submitted, where the run has several players.

    An unfinished run, a shard, a run with `repeats`, a player with several sets of options, or metadata that contradict
    the run, are an `InvalidArgumentError`.
    """
    folder, out = RunFolder(run), Path(out)
    if out.suffix != ".zip":
        raise InvalidArgumentError(f"A bundle is a .zip file; {out} is not named like one.")
    manifest = _part_of(folder, folder.manifest(), player)
    keys = {episode.key for episode in manifest.episodes}
    rows = [row for row in folder.rows() if row["key"] in keys]
    if missing := len(keys) - len(rows):
        remedy = "The command that played it continues it." if manifest.until is None else "Play it without --until."
        raise InvalidArgumentError(
            f"{missing} of {len(keys)} episodes are not finished; a submission holds all of its run. {remedy}"
        )
    submission = _submission(facts, rows)
    for finding in check_suite(read_plan(manifest.to_json()), submission.suite, submission.submission_type):
        raise InvalidArgumentError(finding.text)
    write_bundle(out, _files(folder, manifest, rows, submission))
    return submission


def _part_of(folder: RunFolder, manifest: Manifest, player: str | None) -> Manifest:
    """Return the manifest of one player's part of a run, without what only the run itself needs."""
    if manifest.shard is not None:
        raise InvalidArgumentError(f"{folder.path} holds a shard; merge all shards and submit the whole run.")
    if manifest.repeats is not None:
        raise InvalidArgumentError(
            f"{folder.path} plays every world {manifest.repeats} times; submit a run without repeats."
        )
    names = list(dict.fromkeys(cell.player or "" for cell in manifest.cells))
    if player is None and len(names) > 1:
        raise InvalidArgumentError(f"The run has the players {', '.join(names)}; name the submitted one (--player).")
    player = names[0] if player is None else player
    if player not in names:
        raise InvalidArgumentError(f"The run has no player {player!r}; it has {', '.join(names)}.")
    kept = [number for number, cell in enumerate(manifest.cells) if cell.player == player]
    if any(manifest.cells[number].player_options != manifest.cells[kept[0]].player_options for number in kept):
        raise InvalidArgumentError(f"{player} has several sets of options in {folder.path}; submit a run with one.")
    place = {number: at for at, number in enumerate(kept)}
    return manifest.model_copy(
        update={
            "cells": tuple(manifest.cells[number] for number in kept),
            "episodes": tuple(
                replace(episode, cell=place[episode.cell]) for episode in manifest.episodes if episode.cell in place
            ),
            "prices": {name: price for name, price in manifest.prices.items() if name == player},
            "caps": {},
            "run_file": None,
            "game_files": None,
            "strategy_files": None,
            "spending": None,
        }
    )


def _submission(facts: Mapping[str, Any], rows: list[Row]) -> Submission:
    methodology = {"smartplay_tools_version": metadata.version("smartplay-tools"), **facts.get("methodology", {})}
    results = [result.model_dump(mode="json") for result in cell_results(rows)]
    return read_submission({**facts, "methodology": methodology, "results": results})


def _files(
    folder: RunFolder, manifest: Manifest, rows: list[Row], submission: Submission
) -> Iterator[tuple[str, bytes | Path]]:
    keys = {row["key"] for row in rows}
    environment = {
        "prepared_with": {**versions(), "python": platform.python_version(), "platform": platform.platform()},
        "played_with": manifest.versions,
    }
    yield "submission.json", _json(submission.model_dump(mode="json"))
    yield "environment.json", _json(environment)
    yield "manifest.json", _json(manifest.to_json())
    yield "results.jsonl", "".join(json.dumps(row) + "\n" for row in rows).encode("ascii")
    for key in keys:
        yield f"episodes/{key}.jsonl", folder.transcript(key)
    for record in folder.attempts():
        if record.name.partition(".")[0] in keys:
            yield f"attempts/{record.name}", record


def _json(value: Any) -> bytes:
    return (json.dumps(value, indent=1) + "\n").encode("ascii")
