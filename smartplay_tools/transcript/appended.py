"""AppendedFile: a file that lines are appended to, of which any number can be open at once.

A process may hold few file handles, often 256 or 1,024, and a program may play ten thousand episodes at once. So only
the files that were written last keep their handle; any other is opened again when it is written. What is written is
handed to the operating system at once, so nothing is in memory when a handle is closed.
"""

from __future__ import annotations

import errno
import os
import threading
import weakref
from collections import OrderedDict
from contextlib import suppress
from io import FileIO
from pathlib import Path

HANDLES = 128
"""How many files keep their handle: half of the smallest usual limit of a process, that of macOS."""

_LOCK = threading.Lock()
_IDLE: OrderedDict[weakref.ref[AppendedFile], None] = OrderedDict()
"""The files with a handle that are not being written, the one that was written last at the end."""


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
        self._rest()

    def write(self, lines: bytes) -> None:
        """Append lines; an OSError if that fails, or if the file is no longer as it was written."""
        file = self._opened()
        written = 0
        while written < len(lines):  # all at once, unless the disk is full
            written += file.write(lines[written:])
        self._size += written
        self._rest()

    def close(self) -> None:
        """Close the handle. What a failed write has left of a line is lost."""
        with _LOCK:
            _IDLE.pop(self._reference, None)
            file, self._file = self._file, None
        if file is not None:
            with suppress(OSError):
                file.close()

    def _opened(self) -> FileIO:
        with _LOCK:
            _IDLE.pop(self._reference, None)
        if self._file is None:
            # Not in the mode "ab", which would begin a new file if this one was moved.
            self._file = self._path.open("r+b", buffering=0)
            if self._file.seek(0, os.SEEK_END) != self._size:
                raise OSError(errno.EIO, "another program has changed it")
        return self._file

    def _rest(self) -> None:
        """Keep the handle, and close that of the file that was not written for the longest time if there are many."""
        with _LOCK:
            _IDLE[self._reference] = None
            longest = _IDLE.popitem(last=False)[0]() if len(_IDLE) > HANDLES else None
            if longest is None:
                return
            file, longest._file = longest._file, None
        if file is not None:
            file.close()
