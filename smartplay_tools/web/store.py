"""Episodes by handle: the program that serves opens them, agents with the handle play them, and idle ones are closed.

With a folder, every episode has its transcript there and survives a restart: the recorded calls are played again on a
new game, and their answers compared. A running episode then continues, with its record; a finished one has its recorded
result. Idempotency keys are part of the record, so a call that is repeated after a restart gets the same answer.
"""

from __future__ import annotations

import asyncio
import math
import re
import secrets
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

from smartplay_tools.episode.episode import Episode
from smartplay_tools.errors import SmartPlayError
from smartplay_tools.records.resumption import resume
from smartplay_tools.types import Budget, EpisodeResult, ToolResult
from smartplay_tools.web.hosted import HostedEpisode

HANDLE = re.compile(r"[A-Za-z0-9_-]{32}")
"""The format of a handle: 192 random bits in base64, which cannot be guessed."""


class NotServedError(SmartPlayError):
    """An episode that is asked for is not there; `status` is that of the answer."""

    status = 404


class UnreadableError(NotServedError):
    """The record of an episode cannot be continued."""

    status = 500


class FullError(NotServedError):
    """The largest number of open episodes is reached."""

    status = 503


@dataclass(frozen=True)
class Gone:
    """What a server remembers of an episode that it has closed."""

    result: EpisodeResult | None
    why: str
    """A sentence for those who ask for the episode."""


class Hosted(Protocol):
    """What a server plays: an episode, and how a call of its host's agent is answered."""

    @property
    def episode(self) -> Episode:
        """The episode."""
        ...

    async def ready(self) -> Episode:
        """Return the episode, made if it has to be."""
        ...

    async def call(self, name: str, arguments: Any, call_id: str | None = None) -> ToolResult:
        """Answer a call."""
        ...


H = TypeVar("H", bound=Hosted)


class Store(ABC, Generic[H]):
    """Episodes by handle, each in the form in which a server plays it.

    Arguments:
        folder: the folder of the transcripts; without it, episodes are lost when the process ends.
        most: the largest number of open episodes.
        idle: seconds without a request after which an episode is closed; an episode without any request yet is kept.
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
        self._hosted: dict[str, tuple[H, float]] = {}
        """Open episodes with the time of their last use; never, for one that nobody has asked for yet."""
        self._gone: dict[str, Gone] = {}
        self._busy: set[str] = set()
        """Handles whose episodes are being created, replayed or closed; this may take long, and others play on."""
        self._lock = threading.Condition()

    def __len__(self) -> int:
        return len(self._hosted)

    def open(self, game: str, *, seed: int, budget: Budget | None = None, **options: Any) -> str:
        """Begin an episode and return its handle; raise `FullError` if too many are open. `options` are `Episode`'s."""

        def begin(handle: str) -> H:
            return self._begin(handle, game, seed=seed, budget=budget, transcript=self._path(handle), **options)

        return self.add(begin)

    def hosted(self) -> list[H]:
        """Return all open episodes."""
        with self._lock:
            return [hosted for hosted, _ in self._hosted.values()]

    def gone(self, handle: str) -> Gone | None:
        """Return what is left of an episode that was closed here; None for any other."""
        return self._gone.get(handle)

    def add(self, make: Callable[[str], H], handle: str | None = None) -> str:
        """Add the episode that a function makes for a handle (default: a new one); `FullError` if too many are open."""
        handle = handle or secrets.token_urlsafe(24)
        self._close_idle()
        with self._lock:
            self._make_way(handle)
        self._host(handle, lambda: make(handle), math.inf)
        return handle

    def opened(self, handle: str) -> H | None:
        """Return an episode if it is open; otherwise return None, even if its transcript exists."""
        with self._lock:
            if handle not in self._hosted or self._is_idle(handle):
                return None
            hosted, _ = self._hosted[handle]
            self._hosted[handle] = (hosted, self._clock())
            return hosted

    def find(self, handle: str) -> H | None:
        """Return an episode, if necessary from its transcript; None for an unknown or expired handle.

        Raises `FullError` if too many episodes are open, `TranscriptError` if it plays differently than recorded.
        """
        self._close_idle()
        with self._lock:
            self._lock.wait_for(lambda: handle not in self._busy)
            hosted = self.opened(handle)
            path = self._path(handle)
            if hosted is not None or path is None or not HANDLE.fullmatch(handle) or not path.exists():
                return hosted
            self._make_way(handle)
        return self._host(handle, lambda: self._again(handle, path), self._clock())

    async def asked_for(self, handle: str) -> H:
        """Return an episode, in a thread where it has to be replayed first; `NotServedError` if there is none."""
        try:
            hosted = self.opened(handle) or await asyncio.to_thread(self.find, handle)
        except FullError:
            raise
        except SmartPlayError as error:
            raise UnreadableError("The record of this episode cannot be continued") from error
        if hosted is None:
            raise NotServedError(self._gone[handle].why if handle in self._gone else "No such episode")
        return hosted

    def close(self, handle: str) -> EpisodeResult | None:
        """End an episode and return its result."""
        hosted = self.find(handle)
        if hosted is None:
            return None
        hosted.episode.close()
        with self._lock:
            self._hosted.pop(handle, None)
        self._let_go(handle, hosted, "The episode is over, and was closed.")
        return hosted.episode.result

    def _let_go(self, handle: str, hosted: H, why: str) -> None:
        """Remember what is left of an episode that was closed."""
        self._gone[handle] = Gone(hosted.episode.result, why)

    @abstractmethod
    def _begin(self, handle: str, game: str, **options: Any) -> H:
        """Begin a new episode; the options are `Episode`'s."""

    @abstractmethod
    def _again(self, handle: str, record: Path) -> H:
        """Play an episode again from its record."""

    def _make_way(self, handle: str) -> None:
        if len(self) + len(self._busy) >= self._most:
            raise FullError(f"{self._most} episodes are open, which is the largest number allowed.")
        self._busy.add(handle)

    def _host(self, handle: str, make: Callable[[], H], used: float) -> H:
        try:
            hosted = make()
            with self._lock:
                self._hosted[handle] = (hosted, used)
            return hosted
        finally:
            self._done_with(handle)

    def _close_idle(self) -> None:
        with self._lock:
            idle = {handle: self._hosted.pop(handle)[0] for handle in [*self._hosted] if self._is_idle(handle)}
            self._busy.update(idle)
        with ExitStack() as closing:  # all of them, even if the record of one cannot be written
            for handle, hosted in idle.items():
                closing.callback(self._close_for_good, handle, hosted)

    def _close_for_good(self, handle: str, hosted: H) -> None:
        try:
            hosted.episode.close()
        finally:
            self._let_go(handle, hosted, f"The episode was closed after {self._idle:g} seconds without a request.")
            self._done_with(handle)

    def _done_with(self, handle: str) -> None:
        with self._lock:
            self._busy.remove(handle)
            self._lock.notify_all()

    def _is_idle(self, handle: str) -> bool:
        return self._hosted[handle][1] < self._clock() - self._idle

    def _path(self, handle: str) -> Path | None:
        return None if self._folder is None else self._folder / f"{handle}.jsonl"


class EpisodeStore(Store[HostedEpisode]):
    """The episodes of an MCP server, whose hosts own the context. The arguments are those of `Store`."""

    def _begin(self, handle: str, game: str, **options: Any) -> HostedEpisode:
        hosted = HostedEpisode(Episode(game, context="host", **options))
        hosted.episode.begin()
        return hosted

    def _again(self, handle: str, record: Path) -> HostedEpisode:
        return HostedEpisode(resume(record).episode)
