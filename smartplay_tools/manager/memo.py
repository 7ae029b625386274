"""Memos: where summaries are kept, by digest; the first text under a digest stays."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator, MutableMapping
from contextlib import suppress
from pathlib import Path

from smartplay_tools.errors import InvalidArgumentError

__all__ = ["MemoFolder"]


class MemoFolder(MutableMapping[str, str]):
    """A folder with a file for each text, which processes can share: who writes a text first has written it."""

    def __init__(self, folder: str | Path) -> None:
        self._folder = Path(folder)
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InvalidArgumentError(f"The memo {folder} is no folder: {error.strerror}.") from None

    def __getitem__(self, key: str) -> str:
        """Return a text."""
        path = self._path(key)
        try:
            return path.read_bytes().decode("utf-8", "surrogatepass")
        except FileNotFoundError:
            raise KeyError(key) from None
        except (OSError, UnicodeDecodeError) as error:
            raise InvalidArgumentError(f"The memo's file {path} cannot be read: {error}.") from None

    def __setitem__(self, key: str, text: str) -> None:
        """Write a text; one that is there stays."""
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

    def setdefault(self, key: str, default: str = "") -> str:
        """Write a text unless there is one, and return that which is there."""
        self[key] = default
        return self[key]

    def __contains__(self, key: object) -> bool:
        """Whether there is a text."""
        return self._path(str(key)).exists()

    def __delitem__(self, key: str) -> None:
        """Remove a text."""
        try:
            self._path(key).unlink()
        except FileNotFoundError:
            raise KeyError(key) from None

    def __iter__(self) -> Iterator[str]:
        """Yield the keys."""
        return (path.stem for path in self._folder.glob("*.txt"))

    def __len__(self) -> int:
        """The number of texts."""
        return sum(1 for _ in self)

    def _path(self, key: str) -> Path:
        return self._folder / f"{key}.txt"
