"""A pool of worker processes that do one job at a time, and a map over many records that uses it.

`ProcessPool` plays the attempts of a run. A worker that dies is replaced, and
only its job is lost: a thread cannot be stopped, and `concurrent.futures` gives up all its processes when one of them
dies. So each worker is a process with a pipe. It is spawned, never forked, so that it begins with a clean interpreter
on every system, whatever threads its parent has.

`parallel_map` reads records with a pool; where one of its processes dies, this one does the rest. The results do not
depend on the number of processes, except for their order.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any, Generic, Self, TypeVar

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.games.specs import GAMES

J = TypeVar("J")
A = TypeVar("A")

POLL_SECONDS = 0.2
"""Seconds after which a pool with a free worker asks for a job again."""

END_SECONDS = 5.0
"""What an idle worker may take to end before it is killed."""


ENDING = (signal.SIGINT, signal.SIGTERM)
"""The signals that go to whole groups of processes."""


def is_daemonic() -> bool:
    """Return whether this process may not start others, as a worker of `multiprocessing.Pool` may not."""
    return bool(multiprocessing.current_process().daemon)


def check_may_start_processes() -> None:
    """Raise an `InvalidArgumentError` in a daemonic process."""
    if is_daemonic():
        raise InvalidArgumentError(
            "A daemonic process, such as a worker of multiprocessing.Pool, may not start others: play a run with "
            'executor="async" or executor="inline".'
        )


@dataclass(frozen=True)
class Lost:
    """A job without an answer: its worker died."""

    why: str


class ProcessPool(Generic[J, A]):
    """At most `workers` processes that do `work` on jobs; `work`, jobs and answers must be picklable."""

    def __init__(self, work: Callable[[J], A], workers: int) -> None:
        check_may_start_processes()
        self._work, self._workers = work, workers
        self._crew: list[_Worker[J, A]] = []
        self.has_begun = False
        """Whether any worker could begin."""

    def run(self, take: Callable[[], J | None]) -> Iterator[tuple[J, A | Lost]]:
        """Do jobs while `take` returns them, and yield each with its answer as it is done. May be called again.

        What the work raises is raised here.
        """
        done: list[tuple[J, A | Lost]] = []
        while True:
            while len(self._busy) < self._workers and (job := take()) is not None:
                self._idle().give(job)
            if done:  # while the caller uses the answers, the workers have their next jobs
                yield from done
                done = []
            elif self._busy:
                done = self._answers()
            else:
                return

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for worker in self._crew:
            worker.dismiss()
        for worker in self._crew:
            worker.end(END_SECONDS)
        self._crew.clear()

    @property
    def _busy(self) -> list[_Worker[J, A]]:
        return [worker for worker in self._crew if worker.job is not None]

    def _idle(self) -> _Worker[J, A]:
        for worker in self._crew:
            if worker.job is None:
                return worker
        self._crew.append(_Worker(self._work))
        return self._crew[-1]

    def _answers(self) -> list[tuple[J, A | Lost]]:
        """Wait for answers, or the time to take jobs again; a lost worker leaves the crew."""
        busy, done = self._busy, list[tuple[J, A | Lost]]()
        ready = wait([worker.connection for worker in busy], POLL_SECONDS)
        for worker in busy:
            if worker.connection not in ready:
                continue
            job = worker.job
            assert job is not None
            try:
                answer, error = worker.connection.recv()
            except (EOFError, OSError):
                worker.process.join(1)
                done.append((job, Lost(f"its process ended with code {worker.process.exitcode}")))
                worker.end()
                self._crew.remove(worker)
                continue
            if error is not None:
                raise error
            if worker.has_begun:
                worker.job = None
                done.append((job, answer))
            worker.has_begun = self.has_begun = True
        return done


class _Worker(Generic[J, A]):
    """A process, its pipe, and the job that it has."""

    def __init__(self, work: Callable[[J], A]) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(theirs, work))
        with _signals_wait():
            self.process.start()
        theirs.close()
        self.has_begun = False
        self.job: J | None = None

    def give(self, job: J) -> None:
        self.job = job
        with suppress(BrokenPipeError, ConnectionResetError):  # it has died, which is seen when its answer is read
            self.connection.send(job)

    def dismiss(self) -> None:
        """Let the process end, at once if it has a job."""
        self.connection.close()
        if self.job is not None:
            self.process.kill()

    def end(self, seconds: float = 0.0) -> None:
        """Wait for the process to end, and kill it when the time is over."""
        self.process.join(seconds)
        self.process.kill()
        self.process.join()
        self.connection.close()


@contextmanager
def _signals_wait() -> Iterator[None]:
    """Start processes in which Ctrl-C and SIGTERM wait until they can be ignored: they disturb no import."""
    if sys.platform == "win32" or not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # it would let the signals in again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _serve(connection: Connection, work: Callable[[Any], Any]) -> None:
    """Answer jobs until the pipe is closed."""
    # Ctrl-C and SIGTERM go to whole groups of processes; only the parent handles them.
    for number in ENDING:
        signal.signal(number, signal.SIG_IGN)
    if sys.platform != "win32" and hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    connection.send((None, None))
    while True:
        try:
            job = connection.recv()
        except EOFError:
            return
        try:
            connection.send((work(job), None))
        except Exception as error:
            connection.send((None, _portable(error)))


def _portable(error: Exception) -> Exception:
    """The error as another process can raise it, with its traceback as a note."""
    error.add_note(traceback.format_exc())
    try:
        copy: Exception = pickle.loads(pickle.dumps(error))
    except Exception:  # its constructor takes something other than the message
        return RuntimeError(f"{type(error).__name__}: {error}")
    return copy


def _end_with_parent() -> None:
    """End this worker when its parent has been killed, because it would otherwise never end."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def parallel_map(work: Callable[[J], A], items: Iterable[J], processes: int) -> Iterator[A]:
    """Yield what the work returns for each item, in the order of completion.

    With fewer than two processes, this one does it. `work` and the items must be picklable.
    """
    left, all_live = iter(items), True

    def take() -> J | None:
        return next(left, None) if all_live else None

    if processes > 1:
        with ProcessPool(work, processes) as pool:
            for item, result in pool.run(take):
                all_live = all_live and not isinstance(result, Lost)
                yield work(item) if isinstance(result, Lost) else result
    yield from map(work, left)


def worth(processes: int, records: Iterable[Path], size: int) -> int:
    """Return how many processes these records are worth: one for every `size` bytes, and at most `processes`.

    Only this process is used if it has games that others would not have. A record that its run has moved meanwhile, or
    that cannot be read, counts as empty; reading it will say so.
    """
    if processes == 1 or is_daemonic() or not all(map(GAMES.is_declared, GAMES.added())):
        return 1
    total = 0
    for record in records:
        with suppress(OSError):
            total += record.stat().st_size
    return max(1, min(processes, total // size))
