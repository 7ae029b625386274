"""Episodes by handle: opened by an operator, found by whoever has the handle, gone when nobody has called for long.

With a folder every episode has its transcript there, and a server that was restarted goes on where it stopped: the
calls in the transcript are played again on a fresh game, their answers compared, and the record continues.
"""

from __future__ import annotations

import re
import secrets
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from smartplay_mcp.server import Table
from smartplay_tools import (
    Budget,
    Episode,
    EpisodeResult,
    ResolvedBudget,
    SmartPlayError,
    TranscriptError,
    read_transcript,
)

HANDLE = re.compile(r"[A-Za-z0-9_-]{32}")
"""192 random bits in base64: what nobody guesses."""


class FullError(SmartPlayError):
    """As many episodes are open as may be."""


class Episodes:
    """The open episodes of a server.

    Arguments:
        folder: where the transcripts go; without it nothing outlives the process.
        most: how many episodes may be open.
        idle: seconds without a call after which an episode is closed.
        clock: the time in seconds.
    """

    def __init__(
        self,
        *,
        folder: Path | None = None,
        most: int = 1000,
        idle: float = 1800.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._folder, self._most, self._idle, self._clock = folder, most, idle, clock
        self._tables: dict[str, tuple[Table, float]] = {}
        self._lock = threading.Lock()

    def __len__(self) -> int:
        return len(self._tables)

    def open(self, game: str, *, seed: int, budget: Budget | None = None, **options: Any) -> str:
        """Begin an episode and return its handle; `FullError` if there is no room. `options` are `Episode`'s."""
        with self._lock:
            self._expire()
            if len(self._tables) >= self._most:
                raise FullError(f"{self._most} episodes are open, and no more may be.")
            handle = secrets.token_urlsafe(24)
            episode = Episode(game, seed=seed, budget=budget, context="host", transcript=self._path(handle), **options)
            episode.begin()
            self._tables[handle] = (Table(episode), self._clock())
            return handle

    def find(self, handle: str) -> Table | None:
        """Return an open episode, if need be from its transcript; None for a handle that is not, or no longer."""
        with self._lock:
            self._expire()
            table = self._tables[handle][0] if handle in self._tables else self._recovered(handle)
            if table is not None:
                self._tables[handle] = (table, self._clock())
            return table

    def close(self, handle: str) -> EpisodeResult | None:
        """End an episode and return its result."""
        table = self.find(handle)
        if table is None:
            return None
        with self._lock:
            self._tables.pop(handle, None)
        table.episode.close()
        return table.episode.result

    def _expire(self) -> None:
        limit = self._clock() - self._idle
        for handle in [handle for handle, (_, used) in self._tables.items() if used < limit]:
            self._tables.pop(handle)[0].episode.close()

    def _path(self, handle: str) -> Path | None:
        return None if self._folder is None else self._folder / f"{handle}.jsonl"

    def _recovered(self, handle: str) -> Table | None:
        path = self._path(handle)
        if path is None or not HANDLE.fullmatch(handle) or not path.exists():
            return None
        events = read_transcript(path)
        if any(event["event"] == "end" for event in events) or len(self._tables) >= self._most:
            return None
        return Table(_resumed(path, events))


def _resumed(path: Path, events: list[dict[str, Any]]) -> Episode:
    """Play a transcript's calls again on a fresh game whose record takes the old one's place."""
    start = events[0]
    settings = {key: start[key] for key in ("seed", "engine", "manual", "batch", "context", "tokenizer")}
    again = path.with_suffix(".again")
    again.unlink(missing_ok=True)
    episode = Episode(
        start["game"], budget=ResolvedBudget(**start["budget"]), transcript=again, **settings, **start["options"]
    )
    episode.begin(player=start["player"], protocol=start["protocol"])
    for event in events:
        if event["event"] == "call" and episode.call(event["name"], event["arguments"]).text != event["text"]:
            episode.close()
            again.unlink()
            raise TranscriptError("A transcript plays differently here than it was recorded.")
    again.replace(path)
    return episode
