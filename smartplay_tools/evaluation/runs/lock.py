"""The lock of a run's folder: one process at a time writes a run, and the others are told which one does.

The operating system holds the lock (`flock`, or `LockFileEx` on Windows), so it is released however its process ends,
and nothing has to be cleaned up after a kill. The holder is written to a separate file, because on Windows other
processes cannot read a locked file.
"""

from __future__ import annotations

import json
import os
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from smartplay_tools.errors import InvalidArgumentError

LOCK = ".lock"
HOLDER = ".lock.holder"
"""Names of the two files. The content of the second is valid only while the first is locked."""


@contextmanager
def only_writer(folder: Path) -> Iterator[None]:
    """Hold the lock of an existing folder; raise `InvalidArgumentError` if another process has it."""
    lock = FileLock(folder / LOCK)
    try:
        lock.acquire(blocking=False)
    except Timeout:
        raise InvalidArgumentError(
            f"Another process is writing the run in {folder}{_holder(folder)}; wait for it or name another folder."
        ) from None
    try:
        (folder / HOLDER).write_text(json.dumps(_myself()) + "\n", encoding="utf-8", newline="\n")
        yield
    finally:
        lock.release()


def _myself() -> dict[str, str | int]:
    """A description of this process, with only the first words of its command line: the others may be secret."""
    words = [Path(word).name for word in sys.argv[:1]]
    words += [word for word in sys.argv[1:2] if word.isalpha()]
    return {"process": os.getpid(), "host": socket.gethostname(), "command": " ".join(words)}


def _holder(folder: Path) -> str:
    """The holder of the lock, in brackets; empty if it has not written its file yet."""
    try:
        holder = json.loads((folder / HOLDER).read_text(encoding="utf-8"))
        return f" ({holder['command']}, process {holder['process']} on {holder['host']})"
    except (OSError, ValueError, KeyError, TypeError):
        return ""
