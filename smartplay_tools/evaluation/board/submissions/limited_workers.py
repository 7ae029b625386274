"""The check of records under limits of time and memory: one that crosses them is given up, and the others are checked.

A record from a stranger can make a game slow or large.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import TypeVar

from smartplay_tools.errors import in_one_line
from smartplay_tools.evaluation.board.submissions.bundle import Limits
from smartplay_tools.evaluation.processes import Lost, ProcessPool

J = TypeVar("J")
A = TypeVar("A")

ENVIRONMENT = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "RUST_BACKTRACE": "0"}
"""Keeps numerical libraries from reserving memory for each processor, and pydantic's parser, which is written in Rust,
from printing a backtrace where it has run out of memory: that never ends."""


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

    def take() -> J | None:
        return waiting.pop() if waiting and time.monotonic() < deadline else None

    begin = partial(_limit, limits.memory_bytes)
    with ProcessPool(partial(_guarded, function), workers, begin=begin, seconds=limits.seconds) as pool:
        yield from pool.run(take)
    late = Lost(f"all records together took more than {limits.total_seconds:g} seconds to check")
    yield from ((job, late) for job in reversed(waiting))


def _guarded(function: Callable[[J], A], job: J) -> A | Lost:
    try:
        return function(job)
    except MemoryError:
        return Lost("it needs more memory than is allowed to check")
    except Exception as error:
        return Lost(f"{type(error).__name__}: {in_one_line(error)[:200]}")


def _limit(memory: int) -> None:
    os.environ.update(ENVIRONMENT)
    if sys.platform == "win32":  # it has no such limit
        return
    import resource

    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    if hard == resource.RLIM_INFINITY or hard > memory:
        resource.setrlimit(resource.RLIMIT_AS, (memory, hard))
