"""Reading the folder of a run: its plan, and its finished, running and failed episodes.

    manifest.json         the plan, caps, prices, the run file; written before the first episode
    episodes/KEY.jsonl    the records of finished episodes
    attempts/KEY.N.jsonl  the records of attempts without a result: failed, interrupted, or paused by a cap of the run
    running/KEY.N.jsonl   the records that are being written now
    results.jsonl         a row for every finished episode; no times in it
    status.json           the current figures, while the run is played; deleted when it stops
    timings.jsonl         a row for every attempt: wall time, processor time of the game

Rows can always be computed again from the records. Reading works at any time, also during the run. Only
`evaluation.runs` writes to the folder.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from pydantic import ValidationError

from smartplay_tools.errors import InvalidArgumentError, in_one_line
from smartplay_tools.evaluation.run_folder.manifest import FORMAT, Manifest
from smartplay_tools.records.record import Record
from smartplay_tools.records.rows import Row, read_rows, row_fault
from smartplay_tools.transcript.lines import parse_json

STATUS = "status.json"
"""The name of the status file."""


class RunFolder:
    """A run on disk."""

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)

    def manifest(self) -> Manifest:
        """Return the manifest; raise `InvalidArgumentError` if the folder does not contain a run."""
        path = self.path / "manifest.json"
        try:
            value = parse_json(path.read_bytes())
        except (FileNotFoundError, NotADirectoryError):
            raise InvalidArgumentError(f"{self.path} is not the folder of a run: it has no {path.name}.") from None
        except (ValueError, RecursionError):
            raise InvalidArgumentError(f"{path} is not JSON.") from None
        written = value.get("format") if isinstance(value, dict) else None
        if written != FORMAT:
            raise InvalidArgumentError(
                f"{self.path} was written in format {written}; this version reads format {FORMAT}."
            )
        try:
            return Manifest.model_validate(value)
        except ValidationError as error:
            raise InvalidArgumentError(f"{path} is damaged: {in_one_line(error)}.") from None

    def rows(self) -> list[Row]:
        """Return the rows of the finished episodes, in the order of the plan."""
        order = {episode.key: place for place, episode in enumerate(self.manifest().episodes)}
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


def _place(record: Path) -> tuple[str, int]:
    key, _, attempt = record.stem.partition(".")
    return key, int(attempt or 0)


def records_in(source: Path) -> Iterator[Path]:
    """Yield the records in a run's folder (the finished episodes), a folder of records, or a file."""
    if source.is_file():
        yield source
    elif (source / "manifest.json").exists():
        yield from sorted((source / "episodes").glob("*.jsonl"))
    elif source.is_dir():
        yield from sorted(source.glob("*.jsonl"))
    else:
        raise InvalidArgumentError(f"There is no run and no record at {source}.")
