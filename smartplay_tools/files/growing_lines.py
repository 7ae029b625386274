"""JSON Lines files that another process may write meanwhile: their lines as they grow, and those at both ends."""

from __future__ import annotations

import os
from pathlib import Path

from smartplay_tools.errors import TranscriptError
from smartplay_tools.files.lines import complete_lines, is_complete

__all__ = ["GrowingLines", "ends_of"]

LAST_BYTES = 8_192
"""How much of the end of a file is read at first to find its last line: most records end with shorter ones."""


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
            complete = [line for line in lines[0 if length >= size else 1 :] if is_complete(line)]
            if complete or length >= size:
                return first if is_complete(first) else b"", complete[-1] if complete else b""
            length *= 4
