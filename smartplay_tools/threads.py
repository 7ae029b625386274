"""Threads beside event loops: code that would block a loop, or start a second one in its thread, runs in another.

`SerialQueue` keeps the calls of an episode in their order, in a small pool that all episodes share.

A game's step may take milliseconds or wait for another process, so it must not run on an event loop. One thread per
episode would be too many for ten thousand episodes; here a call that waits for its turn occupies no thread.

Threads are not copied when a process forks, so a forked process begins with none: it starts new threads for the
episodes that it plays, and runs no function that waits in its parent.
"""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

if TYPE_CHECKING:
    from concurrent.futures import Future, ThreadPoolExecutor

Given = ParamSpec("Given")
T = TypeVar("T")

THREADS = 16
"""How many threads all episodes of a process share at most."""

_LOCK = threading.Lock()
"""Held for a few operations at a time: none of them calls out."""

_pool: ThreadPoolExecutor | None = None
"""The threads, once a function has been given."""


class SerialQueue:
    """Runs functions in the shared threads, one at a time, in the order in which they were given."""

    def __init__(self) -> None:
        self._waiting: deque[tuple[Future[Any], Callable[[], Any]]] = deque()
        self._running_in: ThreadPoolExecutor | None = None
        """The threads that run its functions now; those of a parent process run nothing here."""

    async def run(self, function: Callable[[], T]) -> T:
        """Return the result of a function; it is not run if the waiting task is cancelled before it has begun.

        A task that is cancelled later leaves at once, and the function runs to its end, because a thread cannot be
        stopped.
        """
        import asyncio  # loaded with the first call that needs it

        return await asyncio.wrap_future(self._submit(function))

    async def run_to_end(self, function: Callable[[], T]) -> T:
        """Do what `run` does; but a task that is cancelled after the function has begun still waits for its end."""
        import asyncio

        job = self._submit(function)
        waiter = asyncio.wrap_future(job)
        try:
            return await asyncio.shield(waiter)
        except asyncio.CancelledError:
            if not job.cancel():
                await asyncio.wait([waiter])
                waiter.exception()  # asyncio complains of an error that nobody has looked at
            raise

    def _submit(self, function: Callable[[], T]) -> Future[T]:
        from concurrent.futures import Future

        job, pool = Future[T](), _threads()
        with _LOCK:
            if self._running_in is not pool:
                self._waiting.clear()
            self._waiting.append((job, function))
            if self._running_in is pool:
                return job
            self._running_in = pool
        self._go_on(pool)
        return job

    def _go_on(self, pool: ThreadPoolExecutor) -> None:
        """Have the first waiting function run; once the program ends there are no threads, and all have that error."""
        try:
            pool.submit(self._run_next, pool)
        except RuntimeError as error:
            with _LOCK:
                waiting = [*self._waiting]
                self._waiting.clear()
                self._running_in = None
            for job, _ in waiting:
                if job.set_running_or_notify_cancel():
                    job.set_exception(error)

    def _run_next(self, pool: ThreadPoolExecutor) -> None:
        """Run the first waiting function, and then the next one behind those of the other queues."""
        with _LOCK:
            job, function = self._waiting.popleft()
        if job.set_running_or_notify_cancel():
            try:
                job.set_result(function())
            except StopIteration as error:
                job.set_exception(RuntimeError(f"StopIteration, which no task can raise: {error}"))
            except BaseException as error:
                job.set_exception(error)
        with _LOCK:
            has_more = bool(self._waiting)
            self._running_in = pool if has_more else None
        if has_more:
            self._go_on(pool)


def apart_from_event_loop(call: Callable[Given, T], /, *args: Given.args, **kwargs: Given.kwargs) -> T:
    """Call a function that runs its own event loop; if this thread already runs one, in another thread.

    A notebook runs its cells on an event loop. Signals still reach this thread while it waits, so Ctrl-C and the
    notebook's stop button stop a run between two turns as they do elsewhere.
    """
    if not _is_on_event_loop():
        return call(*args, **kwargs)
    from concurrent.futures import ThreadPoolExecutor

    thread = ThreadPoolExecutor(1, "smartplay-tools run")
    try:
        return thread.submit(call, *args, **kwargs).result()
    finally:
        thread.shutdown(wait=False)


def _is_on_event_loop() -> bool:
    import asyncio

    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return False
    return True


def _threads() -> ThreadPoolExecutor:
    from concurrent.futures import ThreadPoolExecutor

    global _pool
    with _LOCK:
        _pool = _pool or ThreadPoolExecutor(THREADS, thread_name_prefix="smartplay")
        return _pool


def _begin_anew() -> None:
    """Give a forked process a lock that nobody holds, and no threads yet."""
    global _LOCK, _pool
    _LOCK, _pool = threading.Lock(), None


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_begin_anew)
