"""The runs of a site, newest first, and what it shows of each, as plain data.

Runs appear and vanish while the site is served. A folder is read again only where it has changed.

Records are opened only for what is being played, and for the episode that is on screen.
"""

from __future__ import annotations

import os
import re
import threading
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from smartplay_tools.errors import InvalidArgumentError, SmartPlayError
from smartplay_tools.evaluation.run_folder.folder import RunFolder
from smartplay_tools.evaluation.run_folder.follower import RunFollower, RunSnapshot
from smartplay_tools.records.damage import DamageError
from smartplay_tools.records.record import Record
from smartplay_tools.records.threads import thread_files
from smartplay_tools.types.arguments import well_formed
from smartplay_tools.web.site.listed import figures, listed
from smartplay_tools.web.site.site_threads import SiteThreads, stamp

SUMMARY = ("planned", "finished", "running", "paused", "failed", "tokens", "cost", "seconds_left", "caps")
"""What the site shows of a snapshot."""

RECORD = re.compile(r"(episodes/[0-9a-f]{16}|(attempts|running)/[0-9a-f]{16}\.[0-9]{1,6})")
"""What names a record in an address; nothing else reaches the disk."""


class SiteRun:
    """One run folder."""

    def __init__(self, path: Path, name: str) -> None:
        self.folder, self.path, self.name = RunFolder(path), path, name
        self._follower = RunFollower(self.folder)
        self._read: tuple[Any, list[list[Any]]] | None = None
        self._lock = threading.Lock()

    def summary(self) -> dict[str, Any]:
        """Return how far the run is: counts, spending, the time that is left; or what is wrong with its folder."""
        try:
            now, seconds = self._snapshot(), sum(self._follower.seconds.values())
        except SmartPlayError as error:
            return {"name": self.name, "error": str(error)}
        finished = [cell for cell in now.cells if cell.finished]
        score = finished[0].score / finished[0].finished if len(finished) == len(now.cells) == 1 else None
        facts = {
            "players": sorted({cell.player for cell in now.cells}),
            "games": sorted({cell.game for cell in now.cells}),
            "score": score,
            "seconds": seconds,
            "written_at": self.written_at,
        }
        return {"name": self.name, **{name: getattr(now, name) for name in SUMMARY}, **facts}

    @property
    def written_at(self) -> float:
        """When the run was begun or ended last, in seconds since the epoch: its manifest is written then."""
        return stamp(self.folder.path / "manifest.json")[0]

    def _snapshot(self) -> RunSnapshot:
        snapshot = self._follower.snapshot()
        if self._follower.damage:
            raise DamageError(self._follower.damage)
        return snapshot

    def episodes(self) -> list[list[Any]]:
        """Return every episode and attempt as an array, in the order of the plan (`listed`)."""
        with self._lock:
            version = self.version()
            if self._read is None or self._read[0] != version:
                self._read = version, self._list()
            return self._read[1]

    def playing(self) -> list[dict[str, Any]]:
        """Return the episodes that are being played, with the tokens of their latest prompt against its cap."""
        playing = self._snapshot().playing
        return [{"key": record.key, **live_figures(record), "record": f"running/{record.name}"} for record in playing]

    def record(self, name: str) -> Path:
        """Return the file of a record, from what names it in an address; `InvalidArgumentError` if there is none.

        An episode that was being played when the address was made may be finished by now.
        """
        if not RECORD.fullmatch(name):
            raise InvalidArgumentError("There is no such record.")
        kind, stem = name.split("/")
        key, _, attempt = stem.partition(".")
        places = [name, f"attempts/{key}.{attempt}", f"episodes/{key}"] if kind == "running" else [name]
        for place in places:
            if (file := self.folder.path / f"{place}.jsonl").is_file():
                return file
        raise InvalidArgumentError("There is no such record; its attempt may have been paused and continued.")

    def is_playing(self, record: Path) -> bool:
        """Return whether the episode of one of its files is being played, which its place says."""
        return record.parent.name == "running"

    def version(self) -> Any:
        """Return something that changes when the list of episodes does."""
        running = [record.name for record in self.folder.running()]
        return [
            *(stamp(self.folder.path / name) for name in ("manifest.json", "results.jsonl", "timings.jsonl")),
            running,
        ] + [record.name for record in self.folder.attempts()]

    def _list(self) -> list[list[Any]]:
        manifest = self.folder.manifest()
        budgets = [cell.describe() for cell in manifest.cells]
        self._follower.snapshot()
        results, attempted, dates = self._follower.results, self._follower.seconds, self._dates()
        others: dict[str, list[dict[str, Any]]] = {}
        together: dict[str, float] = defaultdict(float)
        for (key, _), seconds in attempted.items():
            together[key] += seconds
        for lost in self.folder.failures():
            key, attempt = lost["key"], lost["attempt"]
            what = {"record": f"attempts/{key}.{attempt}", "status": _kind(lost["end_reason"]), "end": lost["error"]}
            others.setdefault(key, []).append({**what, "time": attempted.get((key, attempt))})
        for running in self.folder.running():
            what = {"record": f"running/{running.stem}", "status": "running"}
            others.setdefault(running.stem.partition(".")[0], []).append(what)
        rows: list[dict[str, Any]] = []
        for planned in manifest.episodes:
            cell, key = manifest.cells[planned.cell], planned.key
            facts: dict[str, Any] = {"game": cell.game, "player": cell.player, "budget": budgets[planned.cell]}
            facts |= {"trial": planned.trial, "seed": planned.seed}
            attempts = others.get(key, [])
            if key in results:
                done = {"record": f"episodes/{key}", "status": "finished", "time": together.get(key)}
                rows.append({**done, **facts, **figures(results[key])})
                attempts = [attempt for attempt in attempts if attempt["status"] == "failed"]
            rows += [{**attempt, **facts} for attempt in attempts]
            if key not in results and not attempts:
                rows.append({"status": "waiting", **facts})
        return [listed(**row, date=dates.get(f"{row.get('record')}.jsonl")) for row in rows]

    def _dates(self) -> dict[str, int]:
        """When every record of an episode that is over was written last, by its path in the folder."""
        dates: dict[str, int] = {}
        for kind in ("episodes", "attempts"):
            with suppress(FileNotFoundError), os.scandir(self.folder.path / kind) as files:
                dates |= {f"{kind}/{file.name}": round(file.stat(follow_symlinks=False).st_mtime) for file in files}
        return dates


ViewedRun = SiteRun | SiteThreads
"""What the site can show as a run: a run folder, or a folder of threads."""


def live_figures(record: Record) -> dict[str, Any]:
    """Return how far an episode is that is being played."""
    facts = {name: getattr(record, name) for name in ("game", "player", "seed", "steps")}
    used = {"calls": record.totals.replies, "tokens": record.totals.tokens, "cost": record.totals.cost}
    return {**facts, **used, "silent": round(record.silent_seconds)}


def _kind(reason: str | None) -> str:
    return {"run_budget": "paused", "interrupted": "interrupted"}.get(reason or "", "failed")


DEEPEST = 3
"""How many levels below a named folder are searched for runs."""

PERIOD = 1.0
"""Seconds after which folders are searched again."""


class RunList:
    """The runs in folders, each a run or one that holds some.

    A run is known by its name, which is the path of its folder below the one that was named. `own` are folders that may
    not exist yet, those of the games that are played in the site.
    """

    def __init__(self, folders: Sequence[str | Path] = (), own: Sequence[str | Path] = ()) -> None:
        self._folders = [*map(Path, own), *map(Path, folders)]
        for folder in map(Path, folders):
            if not folder.is_dir():
                raise InvalidArgumentError(f"There is no folder {folder}; name a run's folder, or one that holds runs.")
        self._shown: dict[Path, ViewedRun] = {}
        self._listed: list[ViewedRun] = []
        self._looked = float("-inf")
        self._lock = threading.Lock()

    def current(self) -> list[ViewedRun]:
        """Return the runs that there are now."""
        with self._lock:
            if time.monotonic() - self._looked >= PERIOD:
                self._listed = [*self._look()]
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

    def _look(self) -> list[ViewedRun]:
        names: dict[Path, str] = {}
        for folder in self._folders:
            for path in _runs_in(folder, DEEPEST):
                where = path.resolve()
                if where not in names:
                    name = well_formed(where.name if path == folder else path.relative_to(folder).as_posix())
                    names[where] = path.as_posix().lstrip("/") if name in names.values() else name
        kept = {where: self._shown.get(where) for where in names}
        self._shown = {
            where: run if run is not None and run.name == names[where] else _run(where, names[where])
            for where, run in kept.items()
        }
        return sorted(self._shown.values(), key=lambda run: run.written_at, reverse=True)


def _run(folder: Path, name: str) -> ViewedRun:
    return SiteRun(folder, name) if (folder / "manifest.json").is_file() else SiteThreads(folder, name)


def _runs_in(folder: Path, depth: int) -> Iterator[Path]:
    """Yield the folders of runs and threads at and below a folder, by their names; a run holds no others."""
    if (folder / "manifest.json").is_file():
        yield folder
        return
    if thread_files([folder]):
        yield folder
    if depth:
        try:
            with os.scandir(folder) as entries:
                below = sorted(entry.name for entry in entries if entry.is_dir())
        except OSError:
            return
        for name in below:
            yield from _runs_in(folder / name, depth - 1)
