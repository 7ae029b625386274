"""Threads for asynchronous callers: a small shared pool, and a queue for each episode that keeps its calls in order.

A game's step may take milliseconds or wait for another process, so it must not run on an event loop. One thread per
episode would be too many for ten thousand episodes; here a call that waits for its turn occupies no thread.

Threads are not copied when a process forks, so a forked process begins with none.
"""

from __future__ import annotations

import functools
import os
from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    import asyncio
    from concurrent.futures import ThreadPoolExecutor

T = TypeVar("T")

THREADS = 16
"""How many threads all episodes of a process share at most."""


class SerialQueue:
    """Runs functions in the shared threads, one at a time, in the order in which an event loop gives them.

    Event loops, each in a thread of its own, do not wait for each other here, but for the lock of the episode.
    """

    def __init__(self) -> None:
        self._line: tuple[asyncio.AbstractEventLoop, asyncio.Lock] | None = None
        """The latest event loop, and the lock that the function holds there whose turn it is."""

    async def run(self, function: Callable[[], T], *, to_end: bool = False) -> T:
        """Return the result of a function; it is not run if the waiting task is cancelled before it has begun.

        A task that is cancelled later leaves at once, and the function runs to its end, because a thread cannot be
        stopped; with `to_end` the task waits for that.
        """
        import asyncio  # loaded with the first call that needs it

        loop, line = asyncio.get_running_loop(), self._line
        if line is None or line[0] is not loop:
            self._line = line = loop, asyncio.Lock()
        async with line[1]:
            job = _threads().submit(_result_of, function)
            waiter = asyncio.wrap_future(job)
            try:
                return await (asyncio.shield(waiter) if to_end else waiter)
            except asyncio.CancelledError:
                if to_end and not job.cancel():
                    await asyncio.wait([waiter])
                    waiter.exception()  # asyncio complains of an error that nobody has looked at
                raise


def _result_of(function: Callable[[], T]) -> T:
    try:
        return function()
    except StopIteration as error:
        raise RuntimeError(f"StopIteration, which no task can raise: {error}") from error


@functools.cache
def _threads() -> ThreadPoolExecutor:
    from concurrent.futures import ThreadPoolExecutor

    return ThreadPoolExecutor(THREADS, thread_name_prefix="smartplay")


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_threads.cache_clear)
