"""JSON Lines files of records and rows: reading and appending lines.

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
    return lines if not lines or is_complete(lines[-1]) else lines[:-1]


def is_complete(line: bytes) -> bool:
    """Return whether a line is whole: it has its line break, or is JSON without one."""
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
