"""A run while it is played: its display, and the signals that stop it.

One thread takes a snapshot every second (of hundreds of episodes at once, every five) and shows it.

The first SIGTERM or Ctrl-C stops a run between two turns; the second has its usual effect.
"""

from __future__ import annotations

import multiprocessing
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from types import FrameType
from typing import Any, Self, TypeAlias

from smartplay_tools.errors import TranscriptError
from smartplay_tools.evaluation.run_folder.follower import RunFollower, RunSnapshot
from smartplay_tools.evaluation.runs.run_writer import RunWriter

PERIOD = 1.0
"""The least seconds between two snapshots."""

SHARE, LONGEST_PERIOD = 20, 5.0
"""A snapshot of hundreds of growing records takes long, so the next one waits so many times as long, up to a bound."""

OnSnapshot: TypeAlias = Callable[[RunSnapshot], None]
Display: TypeAlias = Callable[[], AbstractContextManager[OnSnapshot]]
"""Shows snapshots of a run while its context is open."""


@contextmanager
def following(folder: RunWriter, show: OnSnapshot) -> Iterator[None]:
    """Show the run while it is played, and once more when it has stopped."""
    follower, over = RunFollower(folder), threading.Event()

    def tick() -> None:
        # A file that cannot be opened now, for too many that are open, is tried again in a second.
        with suppress(OSError, TranscriptError):
            show(follower.snapshot())

    def follow() -> None:
        pause = 0.0
        while not over.wait(pause):
            began = time.monotonic()
            tick()
            pause = max(PERIOD, min(SHARE * (time.monotonic() - began), LONGEST_PERIOD))

    thread = threading.Thread(target=follow, name="smartplay-tools progress", daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
        tick()


def not_shown() -> AbstractContextManager[OnSnapshot]:
    """Show nothing of a run."""
    return nullcontext(lambda snapshot: None)


CAUGHT = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGBREAK") if hasattr(signal, name))
"""Windows has SIGBREAK, Ctrl-Break, by which one program asks another to end; SIGTERM cannot be caught there."""


class StopFlag:
    """A flag that the run has to stop, in memory that its worker processes share.

    It has no lock, so a signal handler may set it at any time.
    """

    def __init__(self) -> None:
        self._flag = multiprocessing.get_context("spawn").RawValue("b", 0)

    def is_set(self) -> bool:
        """Whether to stop."""
        return bool(self._flag.value)

    def set(self) -> None:
        """Make the attempts stop between two turns."""
        self._flag.value = 1

    def clear(self) -> None:
        """Let the attempts of another executor begin."""
        self._flag.value = 0


class Signals:
    """The signal that was received, which sets the stop flag; `with` handles those that stop a run."""

    def __init__(self, stop: StopFlag) -> None:
        self.received: str | None = None
        """The name of the signal that stopped the run; None while there was none."""
        self._stop = stop
        self._usual: dict[int, Any] = {}

    def __enter__(self) -> Self:
        # Signal handlers can be installed only in the main thread.
        if threading.current_thread() is threading.main_thread():
            self._usual = {number: signal.signal(number, self._receive) for number in CAUGHT}
        return self

    def __exit__(self, *_: object) -> None:
        self._release()

    def _release(self) -> None:
        """Restore the previous signal handlers."""
        for number, usual in self._usual.items():
            signal.signal(number, usual)
        self._usual = {}

    def _receive(self, number: int, frame: FrameType | None) -> None:
        self.received = signal.Signals(number).name
        self._release()
        self._stop.set()
