"""A run while it is played: one thread takes a snapshot every second, writes the status file and shows the snapshot.

`status.json` is for programs that read the folder, `results` in another terminal and the site among them. It is not
part of the results: it has a clock in it, it is deleted when the run stops, and nothing is lost if it is deleted
earlier.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from typing import TypeAlias

from smartplay_tools.evaluation.run_folder.follower import RunFollower
from smartplay_tools.evaluation.run_folder.snapshot import RunSnapshot
from smartplay_tools.evaluation.runs.run_writer import RunWriter

PERIOD = 1.0
"""Seconds between two snapshots."""

OnSnapshot: TypeAlias = Callable[[RunSnapshot], None]
Display: TypeAlias = Callable[[], AbstractContextManager[OnSnapshot]]
"""Shows snapshots of a run while its context is open."""


@contextmanager
def following(folder: RunWriter, show: OnSnapshot) -> Iterator[None]:
    """Write the status file and show the run while it is played, and once more when it has stopped."""
    follower, over = RunFollower(folder), threading.Event()

    def tick() -> None:
        snapshot = follower.count()
        # A file that cannot be replaced now (a full disk, a reader on Windows) is tried again in a second.
        with suppress(OSError):
            folder.write_status(snapshot.figures())
        show(snapshot)

    def follow() -> None:
        tick()
        while not over.wait(PERIOD):
            tick()

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
