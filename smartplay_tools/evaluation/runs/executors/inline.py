"""The inline executor: one attempt after another, in this process."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from typing import ClassVar

from smartplay_tools.evaluation.runs.attempt import play_attempt
from smartplay_tools.evaluation.runs.executors import Again, EndedAttempt, Take
from smartplay_tools.evaluation.runs.limits import Caps, SharedLimits


class InlineExecutor:
    """Plays on the calling thread."""

    records_grow_here: ClassVar[bool] = True

    def __init__(self, workers: int, caps: Caps, spent: tuple[int, float]) -> None:
        self.stop = threading.Event()
        self.limits = SharedLimits(caps, spent) if caps else None

    def close(self) -> None:
        """Do nothing: all resources are released at the end of `run`."""

    def run(self, take: Take, again: Again) -> Iterator[EndedAttempt]:
        """Play the tasks in their order."""
        while (task := take()) is not None:
            yield EndedAttempt(task, play_attempt(task, self.limits, self.stop))
