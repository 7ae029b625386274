"""Times of a record's events, in a file beside the record: for traces that are made afterwards.

A record has no times, because they differ from run to run. With `keep_times` they are kept in a second file,
`NAME.times` beside `NAME.jsonl`, which is part of no hash and no result: it may be deleted at any time, and only traces
need it. Each line is a JSON list of two integers: how many events the record had by then, and the time in nanoseconds
since 1970 (UTC). Lines that a killed process did not write are missing.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from smartplay_tools.errors import TranscriptError
from smartplay_tools.files.lines import AppendedFile

_keeping: list[object] = []
"""A mark for every `keep_times` that has not been ended."""


def keep_times() -> Callable[[], None]:
    """Keep the times of every record that this process opens from now on; return a function that stops it.

    Records in lists have no file beside them. Workers of an evaluation in processes have to call it themselves.
    """
    mark = object()
    _keeping.append(mark)
    return lambda: _keeping.remove(mark)


def times_file(record: str | Path) -> Path:
    """Return the file of a record's times, whether it exists or not."""
    return Path(record).with_suffix(".times")


def read_times(record: str | Path, events: int) -> list[int | None]:
    """Return the time of each of a record's events in nanoseconds since 1970; None where it was not kept.

    `events` is their number. Raises a `TranscriptError` if there is no file of times, or one of another record.
    """
    path = times_file(record)
    try:
        lines = path.read_bytes().splitlines()
    except OSError:
        raise TranscriptError(f"There is no {path}: the times of this record were not kept (`keep_times`).") from None
    times: list[int | None] = [None] * events
    done = 0
    for number, line in enumerate(lines, start=1):
        try:
            count, at = json.loads(line)
            if not done < count <= events:
                raise ValueError
        except (TypeError, ValueError):
            if number == len(lines) and number > 1:
                break  # the process ended while it wrote this line
            raise TranscriptError(f"{path} does not hold the times of {record}: line {number} does not fit.") from None
        times[count - 1] = at
        done = count
    return times


def move_record(record: Path, target: Path) -> None:
    """Move a record, and its times with it."""
    record.replace(target)
    with suppress(FileNotFoundError):
        times_file(record).replace(times_file(target))


def delete_record(record: Path) -> None:
    """Delete a record, if it exists, and its times."""
    record.unlink(missing_ok=True)
    times_file(record).unlink(missing_ok=True)


class TimesWriter:
    """Writes the times of one record."""

    def __init__(self, record: Path, events: int) -> None:
        """`events` is how many events the record has; what an older file of times holds of later ones is dropped."""
        self._events = events
        path = times_file(record)
        lines = path.read_bytes().splitlines(keepends=True) if events and path.exists() else []
        self._file: AppendedFile | None = AppendedFile(path, path.open("wb", buffering=0))
        self._file.write(b"".join(line for line in lines if _is_within(line, events)))

    @classmethod
    def if_kept(cls, record: Path, events: int = 0) -> TimesWriter | None:
        """Return a writer if times are kept in this process."""
        return cls(record, events) if _keeping else None

    def note(self, events: int) -> None:
        """Note that events have been written."""
        now = time.time_ns()
        lines = [[self._events + at, now] for at in range(1, events + 1)]
        self._events += events
        if self._file is None:
            return
        try:
            self._file.write("".join(json.dumps(line) + "\n" for line in lines).encode("ascii"))
        except OSError:
            self.close()  # the record continues without its times, which `read_times` shows

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()
            self._file = None


def _is_within(line: bytes, events: int) -> bool:
    """Whether a line is whole, and about one of the first events."""
    return line.endswith(b"\n") and int(json.loads(line)[0]) <= events
