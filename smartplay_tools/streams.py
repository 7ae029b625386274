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
    before, empty = sys.stdin, io.StringIO()
    with _moved(sys.stdin, 0) as asked, _moved(sys.stdout, 1) as shown, redirect_stdout(sys.stderr):
        _own[:], sys.stdin = (asked, shown), empty
        try:
            yield
        finally:
            sys.stdin = before
            _own.clear()


@contextmanager
def _moved(stream: TextIO, number: int) -> Iterator[TextIO]:
    """Move what the standard descriptor with this number stands for to another one, and return a stream with that."""
    try:
        is_standard = stream.fileno() == number
    except (AttributeError, OSError, ValueError):  # of a caller, or closed
        is_standard = False
    if not is_standard:
        yield stream
        return
    copy, nothing = os.dup(number), os.open(os.devnull, os.O_RDWR)
    mode: Literal["r", "w"] = "r" if number == 0 else "w"
    moved = os.fdopen(copy, mode, encoding=stream.encoding, errors=stream.errors, closefd=number == 1)
    stream.flush()
    os.dup2(nothing, number)
    os.close(nothing)
    if number == 1:
        with suppress(OSError):  # there may be no standard error
            os.dup2(2, 1)
    try:
        yield moved
    finally:
        try:
            stream.flush()
            moved.flush()
        finally:
            os.dup2(copy, number)
            if number == 1:  # a thread may wait for input for ever, and its descriptor stays open
                with suppress(OSError):
                    moved.close()
