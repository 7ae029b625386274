"""A run while it is played: its status file, its display, its methods in a notebook, and the signals that stop it.

One thread takes a snapshot every second (of hundreds of episodes at once, every five), writes the status file and shows
the snapshot. `status.json` is for programs that read the folder, `results` in another terminal and the site among them.
It is not part of the results: it has a clock in it, it is deleted when the run stops, and nothing is lost if it is
deleted earlier.

A notebook shows a run or a sweep as data frames, replays and tables. `pages.notebook` makes all of them and is imported
at first use, so playing a run loads neither pages nor statistics.

The first SIGTERM or Ctrl-C stops a run between two turns; the second has its usual effect.
"""

from __future__ import annotations

import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from types import FrameType
from typing import TYPE_CHECKING, Any, Protocol, Self, TypeAlias

from smartplay_tools.errors import TranscriptError
from smartplay_tools.evaluation.run_folder.follower import RunFollower, RunSnapshot
from smartplay_tools.evaluation.runs.run_writer import RunWriter
from smartplay_tools.records.rows import Row

if TYPE_CHECKING:
    import pandas

    from smartplay_tools.evaluation.pages.notebook import ReplayWidget


PERIOD = 1.0
"""The least seconds between two snapshots."""

SHARE, LONGEST_PERIOD = 20, 5.0
"""A snapshot of hundreds of growing records takes long, so the next one waits so many times as long, up to a bound."""

OnSnapshot: TypeAlias = Callable[[RunSnapshot], None]
Display: TypeAlias = Callable[[], AbstractContextManager[OnSnapshot]]
"""Shows snapshots of a run while its context is open."""


@contextmanager
def following(folder: RunWriter, show: OnSnapshot) -> Iterator[None]:
    """Write the status file and show the run while it is played, and once more when it has stopped."""
    follower, over = RunFollower(folder), threading.Event()

    def tick() -> None:
        # A file that cannot be opened or replaced now (a full disk, too many open files, a reader on Windows) is tried
        # again in a second.
        with suppress(OSError, TranscriptError):
            snapshot = follower.count()
            show(snapshot)
            folder.write_status(snapshot.figures())

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
        folder.drop_status()


def not_shown() -> AbstractContextManager[OnSnapshot]:
    """Show nothing of a run."""
    return nullcontext(lambda snapshot: None)


def is_notebook() -> bool:
    """Return whether the output of this program is shown below the cells of a notebook."""
    ipython = sys.modules.get("IPython")  # a notebook has imported it
    shell = None if ipython is None else ipython.get_ipython()
    return shell is not None and hasattr(shell, "kernel")


class InNotebook:
    """The notebook methods of runs and sweeps, which have `rows`, `failures`, `planned` and `transcript`."""

    rows: Any
    failures: Any
    planned: Any
    transcript: Any

    def to_pandas(self) -> pandas.DataFrame:
        """Return the finished episodes as a data frame, one per row; needs pandas."""
        from smartplay_tools.evaluation.pages.notebook import rows_to_pandas

        return rows_to_pandas(self.rows)

    def show(self, episode: int | str | Row = 0, *, height: int = 760) -> ReplayWidget:
        """Return the replay of an episode, which a notebook shows below the cell.

        `episode` is its index in `rows`, its key or its row; `height` is that of the frame in pixels.
        """
        from smartplay_tools.evaluation.pages.notebook import replay_widget

        return replay_widget(self.rows, self.transcript, episode, height)

    def __repr__(self) -> str:
        failed = self.failures
        latest = failed[-1]["error"] or failed[-1]["end_reason"] if failed else ""
        attempts = f", {len(failed)} failed attempts, the last: {' '.join(latest.split())[:200]}" if failed else ""
        return f"<{type(self).__name__}: {len(self.rows)} of {self.planned} episodes finished{attempts}>"

    def _repr_html_(self) -> str:
        from smartplay_tools.evaluation.pages.notebook import run_as_html

        return run_as_html(self.rows, self.failures, self.planned)


CAUGHT = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGBREAK") if hasattr(signal, name))
"""Windows has SIGBREAK, Ctrl-Break, by which one program asks another to end; SIGTERM cannot be caught there."""


class StopFlag(Protocol):
    """A flag that the run has to stop: a `threading.Event`, or one that is shared with other processes."""

    def is_set(self) -> bool:
        """Whether to stop."""
        ...

    def set(self) -> None:
        """Make the attempts stop between two turns."""
        ...


class Signals:
    """The signal that was received, and the stop flag to set; `with` handles those that stop a run."""

    def __init__(self) -> None:
        self.received: str | None = None
        """The name of the signal that stopped the run; None while there was none."""
        self._stop: StopFlag | None = None
        self._usual: dict[int, Any] = {}

    def tell(self, stop: StopFlag) -> None:
        """Set this flag when a signal arrives, or at once if one already has."""
        self._stop = stop
        if self.received is not None:
            stop.set()

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
        if self._stop is not None:
            self._stop.set()
