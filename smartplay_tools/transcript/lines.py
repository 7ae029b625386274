"""JSON Lines files of records and rows: reading them whole, as they grow, or at both ends, and appending lines.

A file may be read while another process writes it, or after that process was killed. A last line that is incomplete is
then left out; it counts when it has its line break, or is JSON without one.
"""

from __future__ import annotations

import errno
import io
import json
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from pydantic_core import from_json

from smartplay_tools.errors import TranscriptError

LAST_BYTES = 8_192
"""How much of the end of a file is read at first to find its last line: most records end with shorter ones."""


def parse_json(text: str | bytes) -> Any:
    """Return the value of JSON as `json.loads` does, and raise what it raises, in less time."""
    try:
        return from_json(text, cache_strings="keys")
    except (TypeError, ValueError):
        # It is not JSON, or it is what only `json` reads: half of a surrogate pair, or more than 200 levels.
        return json.loads(text)


def parse_lines(lines: Iterable[bytes]) -> list[Any] | None:
    """Return the values of lines of JSON; None if one is not JSON, or is what only `parse_json` reads."""
    try:
        return [from_json(line, cache_strings="all") for line in lines]
    except ValueError:
        return None


def complete_lines(written: bytes) -> list[bytes]:
    """Return the lines of what was read of a file, each with its line break, without an incomplete last one."""
    lines = io.BytesIO(written).readlines()
    return lines if not lines or _is_complete(lines[-1]) else lines[:-1]


class GrowingLines:
    """The lines of a file that may grow, each read once. A file that does not exist has none."""

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.changed_at = 0.0
        """When the file was last written, in seconds since the epoch, as of the last read."""
        self._position, self._file = 0, 0

    def read(self) -> tuple[list[bytes], bool]:
        """Return the lines since the last read, and whether the file was replaced, so that these are all its lines.

        A file that was moved or deleted has no new lines.
        """
        try:
            with self.path.open("rb") as file:
                now = os.fstat(file.fileno())
                replaced = self._file != 0 and (now.st_ino != self._file or now.st_size < self._position)
                if replaced:
                    self._position = 0
                self._file, self.changed_at = now.st_ino, now.st_mtime
                file.seek(self._position)
                # At once: line by line, one that is written meanwhile would be read in two parts.
                lines = complete_lines(file.read())
        except FileNotFoundError:
            return [], False
        except OSError as error:
            raise TranscriptError(f"{self.path} cannot be read: {error.strerror}.") from None
        self._position += sum(map(len, lines))
        return lines, replaced


def ends_of(path: str | Path) -> tuple[bytes, bytes]:
    """Return the first and the last complete line of a file without reading the lines between; b"" for none."""
    with Path(path).open("rb") as file:
        first = file.readline()
        size, length = file.seek(0, os.SEEK_END), LAST_BYTES
        while True:
            file.seek(max(0, size - length))
            tail = file.read(length)
            # Before the first line break is the end of a line that began before, unless everything was read.
            lines = [line + b"\n" for line in tail.split(b"\n")]
            lines[-1] = lines[-1][:-1]
            complete = [line for line in lines[0 if length >= size else 1 :] if _is_complete(line)]
            if complete or length >= size:
                return first if _is_complete(first) else b"", complete[-1] if complete else b""
            length *= 4


def _is_complete(line: bytes) -> bool:
    if line.endswith(b"\n"):
        return True
    if not line.rstrip().endswith(b"}"):
        return False
    try:
        parse_json(line)
    except (ValueError, RecursionError):
        return False
    return True


class AppendedFile:
    """A file to which lines are appended by one thread at a time. It is open only while it is written.

    So a program can play ten thousand episodes at once, whose process may hold few file handles, often 256 or 1,024.
    Nothing is in memory between two writes.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._size = path.absolute(), path.stat().st_size

    def write(self, lines: bytes) -> None:
        """Append lines; an OSError if that fails, or if the file has been changed since it was written."""
        # Not in the mode "ab", which would begin a new file if this one was moved.
        with self._path.open("r+b", buffering=0) as file:
            if file.seek(0, os.SEEK_END) != self._size:
                raise OSError(errno.EIO, "another program has changed it")
            written = file.write(lines)
            while written < len(lines):  # all at once, unless the disk is full
                written += file.write(lines[written:])
            self._size = file.tell()
