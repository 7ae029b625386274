"""The runs of a site: those that its folders hold now, newest first. Runs appear and vanish while it is served."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.web.site.site_runs import SiteRun, ViewedRun

DEEPEST = 3
"""How many levels below a named folder are searched for runs."""

PERIOD = 1.0
"""Seconds after which folders are searched again."""


class RunList:
    """The runs in folders, each a run or one that holds some, and others that are always shown first.

    A run is known by its name, which is the path of its folder below the one that was named. `own` are folders that may
    not exist yet, those of the games that are played in the site.
    """

    def __init__(
        self,
        folders: Sequence[str | Path] = (),
        always: Sequence[ViewedRun] = (),
        own: Sequence[str | Path] = (),
    ) -> None:
        self._folders, self._always = [*map(Path, own), *map(Path, folders)], list(always)
        for folder in map(Path, folders):
            if not folder.is_dir():
                raise InvalidArgumentError(f"There is no folder {folder}; name a run's folder, or one that holds runs.")
        self._shown: dict[Path, SiteRun] = {}
        self._listed: list[ViewedRun] = []
        self._looked = float("-inf")
        self._lock = threading.Lock()

    def current(self) -> list[ViewedRun]:
        """Return the runs that there are now."""
        with self._lock:
            if time.monotonic() - self._looked >= PERIOD:
                self._listed = [*self._always, *self._look()]
                self._looked = time.monotonic()
            return self._listed

    def named(self, name: str) -> ViewedRun | None:
        """Return the run of a name; None if there is none now. One that has just begun is looked for."""
        for _ in range(2):
            run = next((run for run in self.current() if run.name == name), None)
            if run is not None:
                return run
            self._looked = float("-inf")
        return None

    def _look(self) -> list[SiteRun]:
        hidden = {run.path.resolve() for run in self._always}
        names: dict[Path, str] = {}
        for folder in self._folders:
            for path in _runs_in(folder, DEEPEST):
                where = path.resolve()
                if where not in hidden and where not in names:
                    name = where.name if path == folder else path.relative_to(folder).as_posix()
                    taken = name in names.values() or any(run.name == name for run in self._always)
                    names[where] = path.as_posix().lstrip("/") if taken else name
        kept = {where: self._shown.get(where) for where in names}
        self._shown = {
            where: run if run is not None and run.name == names[where] else SiteRun(where, names[where])
            for where, run in kept.items()
        }
        return sorted(self._shown.values(), key=lambda run: run.written_at, reverse=True)


def _runs_in(folder: Path, depth: int) -> Iterator[Path]:
    """Yield the folders of runs at and below a folder, in the order of their names; a run holds no other runs."""
    if (folder / "manifest.json").is_file():
        yield folder
    elif depth:
        try:
            with os.scandir(folder) as entries:
                below = sorted(entry.name for entry in entries if entry.is_dir())
        except OSError:
            return
        for name in below:
            yield from _runs_in(folder / name, depth - 1)


def find_runs(folders: Sequence[str | Path]) -> list[ViewedRun]:
    """Return the runs that folders hold now; none is an `InvalidArgumentError`."""
    runs = RunList(folders).current()
    if not runs:
        raise InvalidArgumentError(f"{', '.join(map(str, folders))} holds no run; smartplay-tools eval makes one.")
    return runs
