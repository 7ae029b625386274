"""Writing a run's folder, by one process at a time, under the folder's lock.

A record is written in `running` and moved when its attempt is over: to `episodes` if the episode is finished, otherwise
to `attempts`. A file in `episodes` is therefore always finished, and there is at most one for each key. Rows can be
computed again from the records at any time, so no received reply is lost if a run is killed. During a run, rows are in
the order of completion; when it stops they are sorted as planned, so that two runs that played the same episodes have
the same bytes, regardless of the number of workers.

One process at a time writes a run. The operating system holds the lock (`flock`, or `LockFileEx` on Windows), so it is
released however its process ends, and nothing has to be cleaned up after a kill.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from smartplay_tools.errors import InvalidArgumentError, SmartPlayError, TranscriptError
from smartplay_tools.evaluation.run_folder.folder import Manifest, RunFolder, replace_file
from smartplay_tools.files.growing_lines import ends_of
from smartplay_tools.files.times import delete_record, move_record
from smartplay_tools.records.damage import damage_named
from smartplay_tools.records.record import Record
from smartplay_tools.records.rows import Row
from smartplay_tools.visible import logger

log = logger("smartplay_tools.evaluation")

LOCK = ".lock"
"""The name of the file that is locked."""


class RunWriter(RunFolder):
    """A run's folder, for the process that writes it and holds its lock (`writing`)."""

    def __init__(self, path: str | Path) -> None:
        super().__init__(path)
        self._attempts: dict[str, int] = {}

    @contextmanager
    def writing(self) -> Iterator[None]:
        """Hold the folder's lock: one run at a time writes here."""
        with ExitStack() as held:
            try:
                for name in ("episodes", "attempts", "running"):
                    (self.path / name).mkdir(parents=True, exist_ok=True)
                held.enter_context(FileLock(self.path / LOCK, blocking=False))
            except Timeout:
                raise InvalidArgumentError(
                    f"Another process is writing the run in {self.path}; wait for it or name another folder."
                ) from None
            except OSError as error:
                raise InvalidArgumentError(
                    f"{self.path} cannot be written ({error.strerror}); name another folder for the run."
                ) from None
            for record in self.attempts():
                self._count(record)
            yield

    def _count(self, record: Path) -> None:
        """Remember the number of an attempt without a result."""
        key, _, attempt = record.stem.partition(".")
        self._attempts[key] = max(int(attempt), self._attempts.get(key, 0))

    def write_manifest(self, manifest: Manifest) -> None:
        """Write the manifest in one operation."""
        replace_file(self.path / "manifest.json", json.dumps(manifest.to_json(), indent=1) + "\n")

    def next_attempt(self, key: str) -> Path:
        """Return the path for the next attempt at an episode if it has no result."""
        return self.path / "attempts" / f"{key}.{self._attempts.get(key, 0) + 1}.jsonl"

    def new_record(self, key: str) -> Path:
        """Return the file that the next attempt at an episode writes."""
        return self.path / "running" / self.next_attempt(key).name

    def latest_attempt(self, key: str) -> Path | None:
        """Return the record of the latest attempt at an episode that has no result, None if there is none."""
        return self.path / "attempts" / f"{key}.{self._attempts[key]}.jsonl" if key in self._attempts else None

    def archive_record(self, record: Record, *, keep: bool = True) -> None:
        """Move the record of an attempt that is over to `episodes` or `attempts`.

        Without `keep`, the record of a paused or interrupted attempt is deleted, because it cannot be continued.
        """
        key, path = record.key, record.path
        assert path is not None
        if not keep and record.outcome in ("paused", "interrupted"):
            delete_record(path)
        elif record.start is None or record.outcome != "finished":
            self.set_aside(path)
        elif record.config.key != key:
            raise TranscriptError(f"{path} is the record of a different episode than the planned one.")
        else:
            move_record(path, self.transcript(key))

    def set_aside(self, path: Path) -> None:
        """Keep a record as that of an attempt without a result, whose episode is played again."""
        move_record(path, self.path / "attempts" / path.name)
        self._count(path)

    def add_attempt(self, record: Path) -> None:
        """Copy the record of an attempt without a result from another folder."""
        copy = self.next_attempt(record.stem.partition(".")[0])
        shutil.copyfile(record, copy)
        self._count(copy)

    def mend(self) -> None:
        """Move the records that a killed run left in `running`, and drop an incomplete last line."""
        timings = self.timings()
        replace_file(self.path / "timings.jsonl", "".join(json.dumps(row) + "\n" for row in timings))
        for path in self.running():
            try:
                with damage_named(path):
                    record = Record.head(path)
                    # A disk that was full, or a process that was killed, can leave a file without a whole event.
                    has_event = record.start is not None or record.ending is not None
                    if record.outcome == "finished" or (not has_event and ends_of(path)[0]):
                        record = Record.read(path)  # a result is read whole, and lines without an event are no record
                    self.archive_record(record, keep=has_event)
            except SmartPlayError as error:
                log.warning("%s Its episode is played again.", error)
                self.set_aside(path)

    def append_row(self, row: Row) -> None:
        """Add the row of a finished episode."""
        _append(self.path / "results.jsonl", row)

    def append_timing(self, row: Row) -> None:
        """Add the row of an attempt."""
        _append(self.path / "timings.jsonl", row)

    def write_rows(self, rows: Iterable[Row]) -> None:
        """Write all rows again, in one operation."""
        replace_file(self.path / "results.jsonl", "".join(json.dumps(row) + "\n" for row in rows))


def _append(path: Path, row: Row) -> None:
    with path.open("a", encoding="ascii", newline="\n") as file:
        file.write(json.dumps(row) + "\n")
