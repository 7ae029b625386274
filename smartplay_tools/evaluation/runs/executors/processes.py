"""The process executor: attempts in worker processes, for players that compute.

Workers are spawned, never forked, so that they begin with a clean interpreter on every system, whatever threads the
parent has. If a worker is killed, for example for its use of memory, the whole pool ends. The lost tasks then continue
from their records, each in its own pool, so that only the task that kills its worker fails.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import ClassVar

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.runs.attempt import Stop, Task, Times, play_attempt
from smartplay_tools.evaluation.runs.executors import POLL_SECONDS, Again, Outcome, Take
from smartplay_tools.evaluation.runs.limits import Caps, Limits, SharedLimits
from smartplay_tools.transcript.file import append_exception

_here: tuple[Limits | None, Stop]
"""In a worker: the objects that its attempts share with the other workers."""


class ProcessExecutor:
    """Plays in `workers` processes."""

    records_grow_here: ClassVar[bool] = True

    def __init__(self, workers: int, caps: Caps, spent: tuple[int, float]) -> None:
        _check_main_module()
        self._workers = workers
        self.stop = _SharedFlag()
        self._begun = _SharedFlag()
        self.limits = SharedLimits(caps, spent, processes=True) if caps else None

    def close(self) -> None:
        """Do nothing: all resources are released at the end of `run`."""

    def run(self, take: Take, again: Again) -> Iterator[Outcome]:
        """Play the tasks, `workers` at a time; those whose worker died come last, each in its own pool."""
        lost: list[Task] = []
        while True:
            yield from self._run_pool(take, lost)
            if not lost:
                return
            if not self._begun.is_set():
                raise InvalidArgumentError(
                    "No worker process could begin; its error is above. Workers import the program's main module:"
                    ' start the run below `if __name__ == "__main__":`, or pass executor="async" or executor="inline".'
                )
            while lost:
                yield self._run_alone(lost.pop(0), again)

    def _run_pool(self, take: Take, lost: list[Task]) -> Iterator[Outcome]:
        under_way: dict[Future[Times], Task] = {}
        with self._pool(self._workers) as pool:
            while True:
                # One task more than there are workers is submitted, so that no worker has to wait.
                while not lost and len(under_way) <= self._workers and (task := take()) is not None:
                    under_way[_submit(pool, task)] = task
                if not under_way:
                    return
                done, _ = wait(under_way, POLL_SECONDS, return_when=FIRST_COMPLETED)
                for future in done:
                    task = under_way.pop(future)
                    if (times := _result(future)) is None:
                        lost.append(task)
                    else:
                        yield Outcome(task, times)

    def _run_alone(self, task: Task, again: Again) -> Outcome:
        if self.stop.is_set():
            return Outcome(task, None)
        task = again(task)
        with self._pool(1) as pool:
            times = _result(_submit(pool, task))
        if times is None:
            append_exception(task.record, "The worker process died while it played this episode.")
        return Outcome(task, times)

    def _pool(self, workers: int) -> ProcessPoolExecutor:
        spawn = multiprocessing.get_context("spawn")
        return ProcessPoolExecutor(workers, spawn, initializer=_begin, initargs=(self.limits, self.stop, self._begun))


def _check_main_module() -> None:
    """Refuse a program that was read from standard input: workers could not import it."""
    main = sys.modules["__main__"]
    path = getattr(main, "__file__", None)
    if path is not None and getattr(main, "__spec__", None) is None and not Path(path).exists():
        raise InvalidArgumentError(
            f"Worker processes import the program's main module, and {path} is not a file: put the program into one, or"
            ' pass executor="async" or executor="inline".'
        )


class _SharedFlag:
    """A flag in shared memory. It has no lock, so a signal handler may set it at any time."""

    def __init__(self) -> None:
        self._flag = multiprocessing.get_context("spawn").RawValue("b", 0)

    def set(self) -> None:
        self._flag.value = 1

    def is_set(self) -> bool:
        return bool(self._flag.value)


def _submit(pool: ProcessPoolExecutor, task: Task) -> Future[Times]:
    """Submit a task to the pool. If the pool has just broken, the task counts as lost like those that it had."""
    try:
        return pool.submit(_play, task)
    except BrokenProcessPool as error:
        refused: Future[Times] = Future()
        refused.set_exception(error)
        return refused


def _result(future: Future[Times]) -> Times | None:
    try:
        return future.result()
    except BrokenProcessPool:
        return None


def _begin(limits: Limits | None, stop: Stop, begun: _SharedFlag) -> None:
    global _here
    _here = (limits, stop)
    begun.set()
    # Ctrl-C and SIGTERM go to whole groups of processes; only the parent handles them.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End this worker when its parent has been killed, because it would otherwise never end."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _play(task: Task) -> Times:
    return play_attempt(task, *_here)
