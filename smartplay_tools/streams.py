"""The standard streams of a program whose output has a format, such as JSON or the messages of MCP.

Games, players, strategies and the programs that they start share the standard streams. A line that they print would
stand in the middle of the format, and a line that they read would be missing from the program's input. Under
`keep_streams` descriptor 0 is empty and descriptor 1 is standard error for all of them, and the program itself uses
`own_input` and `own_output`. It begins before any such code is imported.
"""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from typing import Literal, TextIO

from smartplay_tools.visible import written_as

__all__ = ["keep_streams", "own_input", "own_output"]

_own: list[TextIO] = []
"""The program's input and output, while they are kept."""


def own_input() -> TextIO:
    """Return the program's input."""
    return _own[0] if _own else sys.stdin


def own_output() -> TextIO:
    """Return the program's output."""
    return _own[1] if _own else sys.stdout


@contextmanager
def keep_streams() -> Iterator[None]:
    """Keep both streams for this program; inside of another `keep_streams` nothing changes.

    Where a caller of this process has put others in their places, as tests do, only Python's names for them change.
    """
    if _own:
        yield
        return
    _open_all()
    before, empty = sys.stdin, io.StringIO()
    with _moved(sys.stdin, 0) as asked, _moved(sys.stdout, 1) as shown, redirect_stdout(sys.stderr or sys.stdout):
        _own[:], sys.stdin = (asked, shown), empty
        try:
            yield
        finally:
            sys.stdin = before
            _own.clear()


def _open_all() -> None:
    """Open the standard descriptors that were closed, so that no other file gets the number of one."""
    while (number := os.open(os.devnull, os.O_RDWR)) <= 2:
        pass
    os.close(number)


@contextmanager
def _moved(stream: TextIO | None, number: Literal[0, 1]) -> Iterator[TextIO]:
    """Move what a standard descriptor stands for to another one, and return a stream with that."""
    try:
        is_standard = stream is not None and stream.fileno() == number
    except (AttributeError, OSError, ValueError):  # a caller's
        is_standard = False
    if stream is None or not is_standard:
        yield stream or io.StringIO()
        return
    stream.flush()
    copy = os.dup(number)
    mode: Literal["r", "w"] = "r" if number == 0 else "w"
    # By lines, so that an error of the disk is raised where something is written.
    moved = os.fdopen(copy, mode, 1, stream.encoding, stream.errors, closefd=number == 1)
    if number == 0:
        nothing = os.open(os.devnull, os.O_RDWR)
        os.dup2(nothing, 0)
        os.close(nothing)
    else:
        os.dup2(2, 1)
    try:
        yield written_as(stream, moved) if number == 1 else moved
        moved.flush()
    finally:
        with suppress(OSError):
            stream.flush()
        os.dup2(copy, number)
        if number == 1:  # a thread may wait for input for ever, so that stays open
            with suppress(OSError):
                moved.close()
