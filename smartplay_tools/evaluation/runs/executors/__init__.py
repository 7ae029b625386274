"""Executors, which run the attempts of a run, several at a time.

    inline       one after another, in this process: for a person, for debugging
    processes    in worker processes: for players that compute
    async        on one event loop: for players that wait, hundreds at a time
    ray          on the machines of a Ray cluster

All have the same interface: an executor takes tasks while it has free workers, and yields outcomes in the order of
completion. The record of a task is complete when its outcome is yielded, and it alone determines the result.

The inline executor: one attempt after another, in this process.
"""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from smartplay_tools.evaluation.runs.attempt import Task, Times, play_attempt
from smartplay_tools.evaluation.runs.limits import Caps, RunLimits, SharedLimits
from smartplay_tools.evaluation.runs.run_progress import StopFlag
from smartplay_tools.registry import Registry


@dataclass(frozen=True)
class EndedAttempt:
    """The end of an attempt; `times` is None if they could not be measured."""

    task: Task
    times: Times | None


Take = Callable[[], Task | None]
"""Returns the next task, or None if there is none now: either none is left, or the others wait for an attempt that
is running."""


Again = Callable[[Task], Task]
"""Keeps the record of a task whose worker was lost, and returns the task that continues it."""


class Executor(ABC):
    """Runs attempts. Its `stop` and `limits` are accessible to the attempts, wherever they run."""

    stop: StopFlag
    limits: RunLimits | None

    def __init__(self, workers: int, caps: Caps, spent: tuple[int, float], stop: StopFlag) -> None:
        """Make an executor whose attempts, `workers` at a time, are made in this process."""
        self._workers, self.stop = workers, stop
        self.limits = SharedLimits(caps, spent) if caps else None

    @abstractmethod
    def run(self, take: Take, again: Again) -> Iterator[EndedAttempt]:
        """Run attempts while there are tasks, and yield their outcomes as they complete. May be called again."""

    def close(self) -> None:  # noqa: B027 - most release everything at the end of `run`
        """Release the executor's resources; it runs no more attempts."""


EXECUTORS = Registry(
    "executor",
    {
        "async": "smartplay_tools.evaluation.runs.executors.asynchronous:AsyncExecutor",
        "inline": "smartplay_tools.evaluation.runs.executors:InlineExecutor",
        "processes": "smartplay_tools.evaluation.runs.executors.processes:ProcessExecutor",
        "ray": "smartplay_tools.evaluation.runs.executors.ray:RayExecutor",
    },
)
"""name -> class, which is called with `workers, caps, spent, stop`."""

WAITING_AT_ONCE = 64
"""The default of concurrent episodes: about as many as providers accept, and few enough for any machine."""


def default_workers(name: str) -> int:
    """Return the default number of concurrent attempts of an executor: for processes, one for every processor."""
    return {"inline": 1, "async": WAITING_AT_ONCE}.get(name) or os.cpu_count() or 1


class InlineExecutor(Executor):
    """Plays on the calling thread."""

    def run(self, take: Take, again: Again) -> Iterator[EndedAttempt]:
        """Play the tasks in their order."""
        while (task := take()) is not None:
            yield EndedAttempt(task, play_attempt(task, self.limits, self.stop))
