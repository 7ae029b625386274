"""What the site shows of a folder with records of a context manager: a run whose episodes are threads."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import Any

from smartplay_tools.errors import InvalidArgumentError, SmartPlayError
from smartplay_tools.manager.record import read_thread
from smartplay_tools.records.threads import thread_files, thread_row
from smartplay_tools.web.site.listed import listed

THREADS = "threads"
"""The kind of a record in an address, and what stands in the place of a run's games."""

MANAGER = "context manager"
"""What stands in the place of a player."""

LIVE = 600.0
"""Seconds after its last prompt in which a thread counts as going on: nothing in a record says that it has ended."""


class SiteThreads:
    """A folder of threads."""

    def __init__(self, path: Path, name: str) -> None:
        self.path, self.name = path, name
        self._rows: dict[Path, tuple[Any, dict[str, Any]]] = {}
        self._lock = threading.Lock()

    def _read(self) -> dict[Path, dict[str, Any]]:
        """The figures of each thread; a file is read again where it has grown, and one that cannot be read is named."""
        with self._lock:
            files = thread_files([self.path])
            for file in files:
                found = stamp(file)
                if file not in self._rows or self._rows[file][0] != found:
                    try:
                        row = thread_row(read_thread(file))
                    except SmartPlayError as error:
                        row = {"thread": file.stem, "error": str(error)}
                    self._rows[file] = found, row
            return {file: self._rows[file][1] for file in files}

    def summary(self) -> dict[str, Any]:
        """Return the counts."""
        rows = self._read()
        live = sum(self.is_playing(file) for file in rows)
        counts = {"planned": len(rows), "finished": len(rows) - live, "running": live, "paused": 0}
        failed = sum("error" in row for row in rows.values())
        spent = {"tokens": sum(row.get("tokens", 0) for row in rows.values()), "cost": None, "seconds": 0.0}
        facts = {"players": [MANAGER], "games": [THREADS], "score": None, "written_at": self.written_at}
        return {"name": self.name, **counts, "failed": failed, **spent, "seconds_left": None, "caps": {}, **facts}

    @property
    def written_at(self) -> float:
        """When a thread was written last, in seconds since the epoch."""
        return max((stamp(file)[0] for file in thread_files([self.path])), default=0.0)

    def episodes(self) -> list[list[Any]]:
        """Return every thread as an array (`listed`)."""
        return [self._row(file, row) for file, row in self._read().items()]

    def _row(self, file: Path, row: dict[str, Any]) -> list[Any]:
        facts = {
            "record": f"{THREADS}/{file.stem}",
            "game": file.stem,
            "player": MANAGER,
            "date": round(stamp(file)[0]),
        }
        if error := row.get("error"):
            return listed(**facts, status="failed", budget="", end=error)
        return listed(
            **facts,
            status="running" if self.is_playing(file) else "finished",
            budget="no cap" if row["cap"] is None else f"at most {row['cap']:,} tokens",
            steps=row["prompts"],
            tokens=row["tokens"],
            mistakes=row["refusals"],
            cut=row["cut"],
            end=f"{row['over']} prompts over by the provider's count" if row["over"] else "",
        )

    def playing(self) -> list[dict[str, Any]]:
        """Return the threads that go on, with their figures."""
        live = [(file, row) for file, row in self._read().items() if "error" not in row and self.is_playing(file)]
        names = [{"key": file.stem, "game": file.stem, "record": f"{THREADS}/{file.stem}"} for file, _ in live]
        return [
            {**name, "player": MANAGER, "seed": None, "cost": None, "silent": round(time.time() - stamp(file)[0])}
            | {"steps": row["prompts"], "calls": row["prompts"], "tokens": row["tokens"]}
            for name, (file, row) in zip(names, live, strict=True)
        ]

    def record(self, name: str) -> Path:
        """Return the file of a thread, of those that the folder has now."""
        kind, _, stem = name.partition("/")
        for file in thread_files([self.path]) if kind == THREADS else ():
            if file.stem == stem:
                return file
        raise InvalidArgumentError("There is no such record.")

    def is_playing(self, record: Path) -> bool:
        """Return whether a thread goes on."""
        return time.time() - stamp(record)[0] < LIVE


def stamp(file: Path) -> tuple[float, int]:
    """When a file was written last, and its size; it may have gone."""
    try:
        stat = file.stat()
    except OSError:
        return 0.0, 0
    return stat.st_mtime, stat.st_size
