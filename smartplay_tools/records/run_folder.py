"""Reading the folder of a run: its plan, and its finished, running and failed episodes.

    manifest.json         the plan, caps, prices, the run file; written before the first episode
    episodes/KEY.jsonl    the records of finished episodes
    attempts/KEY.N.jsonl  the records of attempts without a result: failed, interrupted, or paused by a cap of the run
    running/KEY.N.jsonl   the records that are being written now
    results.jsonl         a row for every finished episode; no times in it
    status.json           the current figures, while the run is played; deleted when it stops
    timings.jsonl         a row for every attempt: wall time, processor time of the game

Rows can always be computed again from the records. Reading works at any time, also during the run. Only
`evaluation.run` writes to the folder.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from smartplay_tools.episode.config import CellConfig
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.records.record import Record
from smartplay_tools.records.rows import Row, read_rows, row_fault
from smartplay_tools.records.shards import shard_of

FORMAT = 1
"""The version of this layout; folders with another version are refused."""


STATUS = "status.json"
"""The name of the status file."""

KEY = re.compile(r"[0-9a-f]{16}")
"""What the key of an episode looks like; it is part of the names of files."""


class RunFolder:
    """A run on disk."""

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)

    def manifest(self) -> dict[str, Any]:
        """Return the manifest; raise `InvalidArgumentError` if the folder does not contain a run."""
        try:
            manifest: dict[str, Any] = json.loads((self.path / "manifest.json").read_text(encoding="utf-8"))
        except (FileNotFoundError, NotADirectoryError):
            raise InvalidArgumentError(f"{self.path} is not the folder of a run: it has no manifest.json.") from None
        except (ValueError, RecursionError):
            raise InvalidArgumentError(f"{self.path / 'manifest.json'} is not JSON.") from None
        written = manifest.get("format") if isinstance(manifest, dict) else None
        if written != FORMAT:
            raise InvalidArgumentError(
                f"{self.path} was written in format {written}; this version reads format {FORMAT}."
            )
        if fault := next(_faults(manifest), None):
            raise InvalidArgumentError(f"{self.path / 'manifest.json'} is damaged: {fault}.")
        return manifest

    def planned(self) -> list[dict[str, Any]]:
        """Return the episodes that belong in this folder (a shard's, if it is one), each as key, cell, trial and seed.

        `cell` is the number of the cell in the manifest.
        """
        manifest = self.manifest()
        episodes: list[dict[str, Any]] = manifest["episodes"]
        if manifest["shard"] is None:
            return episodes
        number, count = manifest["shard"]
        digests = [CellConfig(**cell).digest for cell in manifest["cells"]]
        return [e for e in episodes if shard_of(digests[e["cell"]], e["trial"], count) == number]

    def rows(self) -> list[Row]:
        """Return the rows of the finished episodes, in the order of the plan."""
        order = {episode["key"]: place for place, episode in enumerate(self.manifest()["episodes"])}
        rows = {row["key"]: row for row in self._rows() if row["key"] in order}
        return sorted(rows.values(), key=lambda row: order[row["key"]])

    def _rows(self) -> Iterator[Row]:
        path = self.path / "results.jsonl"
        for number, row in enumerate(read_rows(path), start=1):
            if fault := row_fault(row):
                raise InvalidArgumentError(f"Line {number} of {path} is damaged: {fault}.")
            yield row

    def failures(self) -> list[Row]:
        """Return a row for every attempt without a result: `key, attempt, end_reason, error, game, player, seed`.

        The end reason is that of the episode; "exception" if there was no episode yet, "interrupted" if the run was
        stopped or killed, "run_budget" if a cap of the run paused it.
        """
        return [self.failure(Record.head(path)) for path in self.attempts()]

    @staticmethod
    def failure(record: Record) -> Row:
        """Return the row of an attempt without a result."""
        facts = {name: getattr(record.config, name) if record.start else None for name in ("game", "player", "seed")}
        ended = {"end_reason": record.end_reason, "error": record.error}
        return {"key": record.key, "attempt": record.attempt, **ended, **facts}

    def attempts(self) -> list[Path]:
        """Return the records of attempts without a result, by key and then in their order."""
        return sorted((self.path / "attempts").glob("*.jsonl"), key=_place)

    def running(self) -> list[Path]:
        """Return the records that are being written now, or were when the run was killed."""
        return sorted((self.path / "running").glob("*.jsonl"), key=_place)

    def timings(self) -> list[Row]:
        """Return a row for every attempt at an episode, in the order of completion."""
        return list(read_rows(self.path / "timings.jsonl"))

    def transcript(self, key: str) -> Path:
        """Return the path of a finished episode's record."""
        return self.path / "episodes" / f"{key}.jsonl"

    def finished(self) -> set[str]:
        """Return the keys of the episodes that have the record of a finished attempt."""
        with suppress(FileNotFoundError, NotADirectoryError), os.scandir(self.path / "episodes") as files:
            return {file.name.removesuffix(".jsonl") for file in files if file.name.endswith(".jsonl")}
        return set()

    def records(self) -> Iterator[Path]:
        """Yield the records of all attempts: finished, without a result, and running."""
        yield from sorted((self.path / "episodes").glob("*.jsonl"))
        yield from self.attempts()
        yield from self.running()


FIELDS = {"seed": int, "cells": list, "episodes": list, "prices": dict}
"""What every manifest has, with its type in JSON."""

EPISODE_FIELDS = {"key": str, "cell": int, "trial": int, "seed": int}


def _faults(manifest: dict[str, Any]) -> Iterator[str]:
    """Yield what keeps a manifest from being read."""
    for name, kind in FIELDS.items():
        if not isinstance(manifest.get(name), kind):
            yield f"{name} is missing or no {kind.__name__}"
    if "shard" not in manifest:
        yield "shard is missing"
    for cell in manifest["cells"]:
        if not isinstance(cell, dict) or not isinstance(cell.get("game"), str):
            yield "a cell has no game"
    for episode in manifest["episodes"]:
        fields = EPISODE_FIELDS.items()
        if not isinstance(episode, dict) or not all(isinstance(episode.get(name), kind) for name, kind in fields):
            yield "an episode lacks its key, cell, trial or seed"
        elif not KEY.fullmatch(episode["key"]) or not 0 <= episode["cell"] < len(manifest["cells"]):
            yield "an episode has a key or a cell that cannot be"


def _place(record: Path) -> tuple[str, int]:
    key, _, attempt = record.stem.partition(".")
    return key, int(attempt or 0)
