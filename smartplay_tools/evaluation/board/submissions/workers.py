"""Workers: processes that check records under limits of time and memory, and are ended when they cross them.

A record from a stranger can make a game slow or large. A thread could not be stopped and a process pool would break, so
each worker is a process with a pipe: one that takes too long, needs too much memory or crashes is ended and replaced,
and only its record is lost.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from typing import Any, Generic, TypeVar

from smartplay_tools.evaluation.board.submissions.bundle import Limits

J = TypeVar("J")
A = TypeVar("A")

ENVIRONMENT = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "RUST_BACKTRACE": "0"}
"""Keeps numerical libraries from reserving memory for each processor, and pydantic's parser, which is written in Rust,
from printing a backtrace where it has run out of memory: that never ends."""


class Lost:
    """A job without an answer: its worker crossed a limit or crashed."""

    def __init__(self, why: str) -> None:
        self.why = why


def run_limited(
    function: Callable[[J], A], jobs: Sequence[J], workers: int, limits: Limits
) -> Iterator[tuple[J, A | Lost]]:
    """Yield every job with its answer, in the order of completion; `function` is imported by the workers.

    With 0 workers the jobs are done here, without limits.
    """
    if workers == 0:
        yield from ((job, function(job)) for job in jobs)
        return
    waiting, deadline = list(reversed(jobs)), time.monotonic() + limits.total_seconds
    crew: list[_Worker[J, A]] = []
    try:
        while waiting or any(worker.job is not None for worker in crew):
            if time.monotonic() > deadline:
                late = Lost(f"all records together took more than {limits.total_seconds:g} seconds to check")
                yield from ((worker.job, late) for worker in crew if worker.job is not None)
                yield from ((job, late) for job in reversed(waiting))
                return
            while len(crew) < workers and len(crew) < len(jobs):
                crew.append(_Worker(function, limits))
            for worker in crew:
                if worker.job is None and waiting:
                    worker.give(waiting.pop())
            yield from _answers(crew, limits, deadline)
    finally:
        for worker in crew:
            worker.end()


def _answers(crew: list[_Worker[J, A]], limits: Limits, deadline: float) -> Iterator[tuple[J, A | Lost]]:
    """Wait for the first answer, or for the first limit, and yield what came of it; a lost worker leaves the crew."""
    busy = [worker for worker in crew if worker.job is not None]
    until = min([worker.began + limits.seconds for worker in busy] + [deadline])
    ready = wait([worker.connection for worker in busy], max(0.0, until - time.monotonic()) + 0.01)
    for worker in busy:
        job = worker.job
        assert job is not None
        if worker.connection in ready:
            answer = worker.answer()
            yield job, answer
            if not isinstance(answer, Lost) or answer.why == OUT_OF_MEMORY:
                continue
        elif time.monotonic() - worker.began > limits.seconds:
            yield job, Lost(f"it took more than {limits.seconds:g} seconds to check")
        else:
            continue
        worker.end()
        crew.remove(worker)


OUT_OF_MEMORY = "it needs more memory than is allowed to check"


class _Worker(Generic[J, A]):
    """A process, its pipe, and the job that it has."""

    def __init__(self, function: Callable[[J], A], limits: Limits) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(theirs, function, limits.memory_bytes), daemon=True)
        self.process.start()
        theirs.close()
        self.job: J | None = None
        self.began = 0.0

    def give(self, job: J) -> None:
        self.job, self.began = job, time.monotonic()
        with suppress(BrokenPipeError, ConnectionResetError):  # `answer` reports it
            self.connection.send(job)

    def answer(self) -> A | Lost:
        self.job = None
        try:
            answer: A | Lost = self.connection.recv()
        except (EOFError, OSError):
            self.process.join(1)
            return Lost(f"the process that checked it ended with code {self.process.exitcode}")
        return answer

    def end(self) -> None:
        self.connection.close()
        self.process.kill()
        self.process.join()


def _serve(connection: Connection, function: Callable[[Any], Any], memory: int) -> None:
    """Answer jobs until the pipe is closed."""
    os.environ.update(ENVIRONMENT)
    _limit_memory(memory)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the process that started it ends it
    while True:
        try:
            job = connection.recv()
        except EOFError:
            return
        try:
            answer = function(job)
        except MemoryError:
            answer = Lost(OUT_OF_MEMORY)
        connection.send(answer)


def _limit_memory(most: int) -> None:
    if sys.platform == "win32":  # it has no such limit
        return
    import resource

    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    if hard == resource.RLIM_INFINITY or hard > most:
        resource.setrlimit(resource.RLIMIT_AS, (most, hard))
