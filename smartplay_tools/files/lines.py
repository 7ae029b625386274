"""JSON Lines files of records and rows: reading and appending lines.

A file may be read while another process writes it, or after that process was killed. A last line that is incomplete is
then left out; it counts when it has its line break, or is JSON without one.

Any number of files can be open for appending (`AppendedFile`). A process may hold few file handles, often 256 or 1,024,
and a program may play ten thousand episodes at once. So only the files that were written last keep their handle; any
other is opened again when it is written. What is written is handed to the operating system at once, so nothing is in
memory when a handle is closed.
"""

from __future__ import annotations

import errno
import io
import json
import os
import threading
import weakref
from collections import OrderedDict
from contextlib import suppress
from io import FileIO
from itertools import islice
from pathlib import Path
from typing import Any

from pydantic_core import from_json


def parse_json(text: str | bytes) -> Any:
    """Return the value of JSON as `json.loads` does, and raise what it raises, in less time."""
    try:
        return from_json(text)
    except (TypeError, ValueError):
        # It is not JSON, or it is what only `json` reads: half of a surrogate pair, or more than 200 levels.
        return json.loads(text)


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


HANDLES = 128
"""How many files keep their handle: half of the smallest usual limit of a process, that of macOS."""

_LOCK = threading.Lock()
_OPEN: OrderedDict[weakref.ref[AppendedFile], None] = OrderedDict()
"""The files that have a handle, the one that was written last at the end. It is changed while `_LOCK` is held."""


class AppendedFile:
    """A file whose lines are written by one thread at a time.

    Arguments:
        path: the file, which is opened again by this name.
        file: the open file, at its end and without a buffer.
    """

    def __init__(self, path: Path, file: FileIO) -> None:
        self._path = path.absolute()
        self._file: FileIO | None = file
        self._size = file.tell()
        self._reference = weakref.ref(self)
        self._in_use = threading.RLock()
        """Held while the handle is used, so that no other thread closes it meanwhile."""
        self._enter()

    def write(self, lines: bytes) -> None:
        """Append lines; an OSError if that fails, or if the file has been changed since it was written."""
        with self._in_use:
            file = self._file or self._opened_again()
            written = file.write(lines)
            while written < len(lines):  # all at once, unless the disk is full
                written += file.write(lines[written:])
            with _LOCK:
                _OPEN.move_to_end(self._reference)

    def close(self) -> None:
        """Close the handle. What a failed write has left of a line is lost."""
        with self._in_use, _LOCK:
            _OPEN.pop(self._reference, None)
            self._let_go()

    def _opened_again(self) -> FileIO:
        # Not in the mode "ab", which would begin a new file if this one was moved.
        file = self._path.open("r+b", buffering=0)
        if file.seek(0, os.SEEK_END) != self._size:
            file.close()
            raise OSError(errno.EIO, "another program has changed it")
        self._file = file
        self._enter()
        return file

    def _enter(self) -> None:
        """Keep the handle; if there are too many, close that of the file whose last write is longest ago."""
        with _LOCK:
            _OPEN[self._reference] = None
            self._keep(HANDLES)

    @staticmethod
    def _keep(count: int) -> None:
        """Close the handles of all files but those that were written last or are being written; `_LOCK` is held."""
        for reference in list(islice(_OPEN, max(0, len(_OPEN) - count))):
            longest = reference()
            if longest is None:
                del _OPEN[reference]
            elif longest._in_use.acquire(blocking=False):
                del _OPEN[reference]
                longest._let_go()
                longest._in_use.release()

    def _let_go(self) -> None:
        file, self._file = self._file, None
        if file is not None:
            self._size = file.tell()
            with suppress(OSError):
                file.close()


def _before_fork() -> None:
    """Close all handles: parent and child then open the file again, and see whether the other has written it."""
    with _LOCK:
        AppendedFile._keep(0)


def _begin_anew() -> None:
    """In a forked process: make new locks, as the old ones may be held by threads that do not exist here."""
    global _LOCK
    _LOCK = threading.Lock()
    for written in filter(None, [reference() for reference in _OPEN]):
        written._in_use = threading.RLock()
        written._let_go()
    _OPEN.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_before_fork, after_in_child=_begin_anew)
