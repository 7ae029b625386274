"""What the site shows of a single record, finished or growing: a run of one episode."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.run_folder.annotations import read_notes
from smartplay_tools.evaluation.run_folder.follower import Result
from smartplay_tools.records.record import Record
from smartplay_tools.types import Budget
from smartplay_tools.web.site.site_runs import RECORD, figures, live_figures

KEY = "0" * 16
"""The key in addresses: a record by itself has no plan that gives it another."""

PLAYING = f"running/{KEY}.1"
FINISHED = f"episodes/{KEY}"


class SiteRecord:
    """One transcript, from before its first event on."""

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.name = self.path.name
        self._record = Record.follow(self.path)
        self._lock = threading.Lock()

    def _refreshed(self) -> Record:
        with self._lock:
            return self._record.refresh()

    def summary(self) -> dict[str, Any]:
        """Return the counts of a run that has this episode only."""
        record = self._refreshed()
        has_failed = record.outcome == "failed"
        return {
            "name": self.name,
            "planned": 1,
            "finished": int(record.is_complete and not has_failed),
            "running": len(self.playing()),
            "paused": 0,
            "failed": int(has_failed),
            "tokens": record.totals.tokens,
            "cost": record.totals.cost,
            "seconds_left": None,
            "caps": {},
            "players": [record.player] if record.start else [],
            "games": [record.game] if record.start else [],
            "score": None if record.result_data is None else record.result_data["score"],
            "written_at": self.path.stat().st_mtime if self.path.is_file() else 0.0,
        }

    def episodes(self) -> list[list[Any]]:
        """Return the episode as an array (`COLUMNS`), an empty list before its first event."""
        record = self._refreshed()
        if record.start is None:
            return []
        facts = record.facts
        shown = [facts["game"], facts["player"], Budget.from_record(facts["asked"]).describe(), None, facts["seed"]]
        if record.ending is None:
            return [[PLAYING, "running", *shown, *[None] * 11]]
        if record.result_data is None:
            return [[FINISHED, record.outcome, *shown, *[None] * 7, record.error, None, None, self._date]]
        status = "failed" if record.outcome == "failed" else "finished"
        result, notes = Result.of({**record.result_data, "cost": None}), len(read_notes(self.path)) or None
        return [[FINISHED, status, *shown, *figures(result), None, notes, self._date]]

    @property
    def _date(self) -> int:
        """When it was written last, in seconds since the epoch."""
        return round(self.path.stat().st_mtime)

    def playing(self) -> list[dict[str, Any]]:
        """Return the episode while it is played, as `SiteRun.playing` does."""
        record = self._refreshed()
        if record.start is None or record.ending is not None:
            return []
        return [{"key": KEY, **live_figures(record), "record": PLAYING}]

    def is_playing(self, record: Path) -> bool:
        """Return whether the episode is being played."""
        return self._refreshed().ending is None

    def version(self) -> Any:
        """Return something that changes when its report does."""
        return self.path.stat().st_size if self.path.is_file() else 0

    def record(self, name: str) -> Path:
        """Return the file, under any of its names."""
        if not RECORD.fullmatch(name) or name not in (PLAYING, FINISHED) or not self.path.is_file():
            raise InvalidArgumentError("There is no such record.")
        return self.path
