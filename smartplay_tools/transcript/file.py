"""The file of a transcript: one JSON Lines file per episode, with one event per line, written as it happens.

If the process is killed, at most the line being written is lost, and the reader tolerates an incomplete last line. A
file is never overwritten. `TranscriptWriter` writes, and `read_transcript` reads.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, TypeAlias

from smartplay_tools.errors import TranscriptError
from smartplay_tools.files.lines import AppendedFile, complete_lines, parse_json
from smartplay_tools.files.times import TimesWriter
from smartplay_tools.transcript.events import FORMAT, Event, event_fault
from smartplay_tools.transcript.hashing import chained_lines, event_line


class MemoryRecord:
    """A record in memory: the bytes that a file would have. Its events are parsed when they are asked for."""

    def __init__(self) -> None:
        self._lines: list[bytes] = []
        self._events: list[Event] = []

    def append(self, lines: bytes) -> None:
        """Append lines, each with its line break."""
        self._lines.append(lines)

    @property
    def written(self) -> bytes:
        """All lines so far."""
        return b"".join(self._lines)

    @property
    def events(self) -> list[Event]:
        """The events of all lines so far."""
        lines = self.written.splitlines()
        self._events += map(json.loads, lines[len(self._events) :])
        return self._events


Sink: TypeAlias = str | Path | list[Event] | MemoryRecord
"""Where a record is written: a new file, a list of events, or memory."""


class TranscriptWriter:
    """Writes events to a new file or to memory, each with the hash chain up to it.

    If writing to the file fails, the error names the file and nothing more is written. The file then contains the
    beginning of the record, which can be replayed.
    """

    def __init__(self, sink: Sink) -> None:
        self._events: list[Event] | None = sink if isinstance(sink, list) else None
        self._memory: MemoryRecord | None = sink if isinstance(sink, MemoryRecord) else None
        self._file: AppendedFile | None = None
        self.path: Path | None = None
        self._chain = ""
        self._times: TimesWriter | None = None
        if isinstance(sink, str | Path):
            self.path = _usable(sink)
            if self.path.exists():
                raise TranscriptError(f"{self.path} exists, and a record is never overwritten; name another file.")
            try:
                self.path.parent.mkdir(parents=True, exist_ok=True)
                self._file = AppendedFile(self.path, self.path.open("xb", buffering=0))
                self._times = TimesWriter.if_kept(self.path)
            except OSError as error:
                raise TranscriptError(f"{self.path} cannot be written: {error.strerror}.") from None

    @classmethod
    def resume(cls, path: str | Path, events: Iterable[Event]) -> TranscriptWriter:
        """Continue the file from which `read_transcript` returned these events; an incomplete last line is removed."""
        writer = cls.__new__(cls)
        writer._events = writer._memory = None
        writer.path = _usable(path)
        events = list(events)
        writer._chain = events[-1].get("chain", "") if events else ""
        expected = b"".join(event_line(event) + b"\n" for event in events)
        try:
            file = writer.path.open("r+b", buffering=0)
            written = file.read()
            if written == expected[:-1]:
                file.write(b"\n")
            elif written.startswith(expected):
                file.truncate(len(expected))
                file.seek(len(expected))
            else:
                file.close()
                raise TranscriptError(f"{path} was changed after it was written, so it cannot be continued.")
            writer._file = AppendedFile(writer.path, file)
            writer._times = TimesWriter.if_kept(writer.path, len(events))
        except OSError as error:
            raise TranscriptError(f"{path} cannot be continued: {error.strerror}.") from None
        return writer

    def append(self, *events: Mapping[str, Any]) -> None:
        """Write events in one operation: the record contains all of them, or its last line is incomplete."""
        lines, self._chain = chained_lines(events, self._chain)
        if self._events is not None:
            self._events += map(json.loads, lines.splitlines())
        if self._memory is not None:
            self._memory.append(lines)
        if self._file is not None:
            try:
                self._file.write(lines)
                if self._times is not None:
                    self._times.note(len(events))
            except OSError as error:
                self.close()
                raise TranscriptError(
                    f"{self.path} can no longer be written: {error.strerror}; the record ends there."
                ) from error

    def close(self) -> None:
        """Close the file; later events are not written."""
        if self._file is not None:
            self._file.close()
            self._file = None
        if self._times is not None:
            self._times.close()
            self._times = None


def _usable(path: str | Path) -> Path:
    if not str(path):
        raise TranscriptError("A transcript needs the path of a new file; the path given is empty.")
    return Path(path)


def read_transcript(path: str | Path) -> list[Event]:
    """Return the events of a transcript, without an incomplete last line; `TranscriptError` for any other defect."""
    return read_written(path)[0]


def read_written(path: str | Path, *, checks_fields: bool = True) -> tuple[list[Event], bytes]:
    """Return the events of a transcript, and the bytes from which they were read, as `read_transcript` does.

    Without `checks_fields` an event may have any: a replay compares them with those of a new episode.
    """
    events, written = _read(path)
    if not events or events[0]["event"] != "start":
        raise TranscriptError(f"{path} is not a transcript: it does not begin with a start event.")
    check_format(events[0], path)
    if checks_fields:
        for number, event in enumerate(events, start=1):
            if fault := event_fault(event):
                raise TranscriptError(f"{path} is not a transcript: line {number} {fault.rstrip('.')}.")
    return events, written


def _read(path: str | Path) -> tuple[list[Event], bytes]:
    try:
        written = Path(path).read_bytes()
    except FileNotFoundError:
        raise TranscriptError(f"There is no file {path}.") from None
    except OSError as error:
        raise TranscriptError(f"{path} cannot be read: {error.strerror}.") from None
    lines = complete_lines(written) or written.splitlines(keepends=True)  # one line alone is damaged
    return [_parsed(line, path, number) for number, line in enumerate(lines, start=1)], written


def check_format(start: Event, path: object = "The record") -> None:
    """Raise a `TranscriptError` if this version cannot read the record that begins with this event."""
    if start.get("format") != FORMAT:
        raise TranscriptError(
            f"{path} has format {start.get('format')!r}; this version of smartplay-tools reads format {FORMAT} only."
        )


def is_event(value: object) -> bool:
    """Whether a value is an event of some kind, with whatever fields."""
    return isinstance(value, dict) and isinstance(value.get("event"), str)


def read_line(line: bytes, path: object = None) -> Event:
    """Return the event on a line; `TranscriptError` if there is none, or if its fields are not those of its kind."""
    event = _parsed(line, path)
    if fault := event_fault(event):
        raise TranscriptError(f"{path or 'The record'} is not a transcript: one of its lines {fault.rstrip('.')}.")
    return event


def _parsed(line: bytes, path: object, number: int | None = None) -> Event:
    where = "one of its lines" if number is None else f"line {number}"
    try:
        event: Event = parse_json(line)
    except UnicodeDecodeError:
        fault = f"{where} is not text"
    except (ValueError, RecursionError):
        fault = f"{where} is not JSON"
    else:
        if is_event(event):
            return event
        fault = f"{where} is not an event"
    raise TranscriptError(f"{path or 'The record'} is not a transcript: {fault}.")


def append_exception(path: str | Path, error: str, traceback: str | None = None) -> bool:
    """Append an `exception` event to a record, which may be empty: an error outside of the episode.

    Nothing is appended, and False returned, if the episode has come to an end: nothing that fails later undoes it. An
    episode that was closed has not, since an error that passes by closes it.
    """
    events = _read(path)[0] if Path(path).exists() else None
    if events and events[-1]["event"] == "end" and events[-1]["result"]["end_reason"] != "closed":
        return False
    writer = TranscriptWriter(path) if events is None else TranscriptWriter.resume(path, events)
    writer.append({"event": "exception", "error": error, "traceback": traceback})
    writer.close()
    return True


def write_records(records: Mapping[str, str], folder: str | Path) -> list[Path]:
    """Write records that another program kept (file name -> text) to a folder, and return the files.

    An existing file is a `TranscriptError`.
    """
    Path(folder).mkdir(parents=True, exist_ok=True)
    files = []
    for name, record in records.items():
        file = Path(folder) / name
        if file.exists():
            raise TranscriptError(f"{file} exists, and a record is never overwritten; name another folder.")
        file.write_text(record, encoding="utf-8", newline="\n")
        files.append(file)
    return files
