"""Memos: where summaries are kept, by digest; the first text under a digest stays."""

from __future__ import annotations

import os
import threading
from contextlib import suppress
from pathlib import Path
from typing import Protocol

from smartplay_tools.errors import InvalidArgumentError


class Texts(Protocol):
    """What is used of a memo: a mapping has it, and a folder."""

    def get(self, key: str, /) -> str | None:
        """Return a text; None if there is none."""

    def setdefault(self, key: str, text: str, /) -> str:
        """Write a text unless there is one, and return that which is there."""


class MemoFolder:
    """A folder with a file for each text, which processes can share: who writes a text first has written it."""

    def __init__(self, folder: str | Path) -> None:
        self._folder = Path(folder)
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InvalidArgumentError(f"The memo {folder} is no folder: {error.strerror}.") from None

    def get(self, key: str, /) -> str | None:
        """Return a text; None if there is none."""
        path = self._path(key)
        try:
            return path.read_bytes().decode("utf-8", "surrogatepass")
        except FileNotFoundError:
            return None
        except (OSError, UnicodeDecodeError) as error:
            raise InvalidArgumentError(f"The memo's file {path} cannot be read: {error}.") from None

    def setdefault(self, key: str, text: str, /) -> str:
        """Write a text unless there is one, and return that which is there."""
        path = self._path(key)
        new = path.with_suffix(f".{os.getpid()}.{threading.get_ident()}")
        try:
            handle = os.open(new, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)  # it says what an agent has read
            with os.fdopen(handle, "wb") as file:
                file.write(text.encode("utf-8", "surrogatepass"))
            with suppress(FileExistsError):
                os.link(new, path)
            new.unlink()
        except OSError as error:
            raise InvalidArgumentError(f"The memo's file {path} cannot be written: {error.strerror}.") from None
        written = self.get(key)
        return text if written is None else written

    def _path(self, key: str) -> Path:
        return self._folder / f"{key}.txt"
