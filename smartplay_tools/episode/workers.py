"""Threads for asynchronous callers: a small shared pool, and a queue for each episode that keeps its calls in order.

A game's step may take milliseconds or wait for another process, so it must not run on an event loop. One thread per
episode would be too many for ten thousand episodes; here a call that waits for its turn occupies no thread.

Handing a call to another thread costs more than a step of most games. So a thread that has run a function takes the
next waiting function itself. Results go back to an event loop in batches: whenever the loop wakes up, it takes all
results that are ready.

Threads are not copied when a process forks, so a forked process begins with none: it starts new threads for the
episodes that it plays, and runs no function that waits in its parent.
"""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar
from weakref import WeakKeyDictionary

if TYPE_CHECKING:
    import asyncio
    from concurrent.futures import ThreadPoolExecutor

T = TypeVar("T")

THREADS = 16
"""How many threads all episodes of a process share at most."""

PATIENCE = 0.02
"""Seconds: most games' functions take a hundredth of it."""


class SerialQueue:
    """Runs functions in the shared threads, one at a time, in the order in which they were given.

    `is_slow`: its functions wait for something other than Python, so they need their own thread.
    """

    def __init__(self, *, is_slow: bool = False) -> None:
        self.is_slow = is_slow
        self._waiting: deque[_Job] = deque()
        self._running_in: _SharedThreads | None = None
        """The threads that run its functions now; those of a parent process run nothing here."""

    async def run(self, function: Callable[[], T]) -> T:
        """Return the result of a function; it is not run if the waiting task is cancelled before it has begun.

        A task that is cancelled later leaves at once, and the function runs to its end, because a thread cannot be
        stopped.
        """
        result: T = await self._submit(function).waiter
        return result

    async def run_to_end(self, function: Callable[[], T]) -> T:
        """Do what `run` does; but a task that is cancelled after the function has begun still waits for its end."""
        import asyncio

        job = self._submit(function)
        try:
            result: T = await asyncio.shield(job.waiter)
        except asyncio.CancelledError:
            if not job.cancel():
                await asyncio.wait([job.waiter])
                job.waiter.exception()  # asyncio complains of an error that nobody has looked at
            raise
        return result

    def _submit(self, function: Callable[[], Any]) -> _Job:
        job = _Job(function)
        with _LOCK:
            if self._running_in is not _SHARED:
                self._waiting.clear()
            self._waiting.append(job)
            if self._running_in is _SHARED:
                return job
            self._running_in = _SHARED
        _SHARED.add(self)
        return job

    def run_next(self) -> bool:
        """Run the first waiting function; return whether others wait behind it."""
        with _LOCK:
            job = self._waiting.popleft()
        job.run()
        with _LOCK:
            self._running_in = _SHARED if self._waiting else None
            return bool(self._waiting)


class _Job:
    """A function that waits for a thread, and the future of the event loop that waits for it."""

    def __init__(self, function: Callable[[], Any]) -> None:
        from asyncio import get_running_loop  # loaded with the first call that needs it

        self.loop = get_running_loop()
        self.waiter: asyncio.Future[Any] = self.loop.create_future()
        self._function = function
        self._has_begun = self._is_cancelled = False

    def cancel(self) -> bool:
        """Cancel the function, unless it has begun; return whether it never will."""
        with _LOCK:
            self._is_cancelled = not self._has_begun
            return self._is_cancelled

    def run(self) -> None:
        with _LOCK:
            if self._is_cancelled or self.waiter.cancelled():
                return
            self._has_begun = True
        result, error = None, None
        try:
            result = self._function()
        except BaseException as raised:
            error = raised
        _mailbox(self.loop).put(self.waiter, result, error)


class _Mailbox:
    """The results for the futures of one event loop; the loop is woken once for all of them."""

    def __init__(self) -> None:
        self._results: list[tuple[asyncio.Future[Any], Any, BaseException | None]] = []

    def put(self, waiter: asyncio.Future[Any], result: Any, error: BaseException | None) -> None:
        with _LOCK:
            self._results.append((waiter, result, error))
            if len(self._results) > 1:
                return
        try:
            waiter.get_loop().call_soon_threadsafe(self._hand_out)
        except RuntimeError:  # the loop is closed, and nobody waits
            with _LOCK:
                self._results.clear()

    def _hand_out(self) -> None:
        with _LOCK:
            results, self._results = self._results, []
        for waiter, result, error in results:
            if waiter.done():
                continue
            if error is None:
                waiter.set_result(result)
            else:
                waiter.set_exception(error)


class _SharedThreads:
    """The threads of all episodes; each takes one function of a queue after the other until none waits.

    Python runs one thread at a time, and threads that compete for it slow each other down. So one thread does all the
    work as long as it keeps up, and another one stands by. It joins in when no function has begun for `PATIENCE`
    seconds, because the running ones wait for something other than Python, and then the next one stands by.
    """

    def __init__(self) -> None:
        self._pool: ThreadPoolExecutor | None = None
        self._ready: deque[SerialQueue] = deque()
        self._call = threading.Condition(_LOCK)
        self._threads = self._running = self._begun = 0
        """How many threads there are, how many of them run a function, and how many functions have begun in all."""

    def add(self, queue: SerialQueue) -> None:
        """Queue the functions of a queue to run, behind those of the other queues."""
        with _LOCK:
            self._ready.append(queue)
            if not self._running or queue.is_slow:
                self._call.notify()
            is_missing = self._adds_thread()
        if is_missing:
            self._start_thread()

    def _adds_thread(self) -> bool:
        """Count another thread if all of them are busy and there may be more; the caller starts it."""
        adds = self._threads == self._running < THREADS
        self._threads += adds
        return adds

    def _start_thread(self) -> None:
        from concurrent.futures import ThreadPoolExecutor

        with _LOCK:
            if self._pool is None:
                self._pool = ThreadPoolExecutor(THREADS, thread_name_prefix="smartplay")
        self._pool.submit(self._work)

    def _work(self) -> None:
        joins = False
        while (queue := self._next_queue(joins)) is not None:
            has_more = queue.run_next()
            with _LOCK:
                self._running -= 1
                if has_more:
                    self._ready.append(queue)
            joins = True

    def _next_queue(self, joins: bool) -> SerialQueue | None:
        """Wait until this thread is needed and return what it runs next; None if nothing waits.

        `joins` says that it need not wait for the others.
        """
        with _LOCK:
            while self._ready and self._running and not (joins or self._ready[0].is_slow):
                before = self._begun
                self._call.wait(PATIENCE)
                joins = self._begun == before
            if not self._ready:
                self._threads -= 1
                return None
            queue = self._ready.popleft()
            self._running += 1
            self._begun += 1
            is_missing = bool(self._ready) and self._adds_thread()
        if is_missing:
            self._start_thread()
        return queue


_LOCK = threading.Lock()
"""Held for a few operations at a time, by every part of this module: none of them calls out while it holds it."""

_MAILBOXES: WeakKeyDictionary[asyncio.AbstractEventLoop, _Mailbox] = WeakKeyDictionary()
_SHARED = _SharedThreads()


def _begin_anew() -> None:
    """Give a forked process a lock that nobody holds, and no threads yet."""
    global _LOCK, _MAILBOXES, _SHARED
    _LOCK, _MAILBOXES = threading.Lock(), WeakKeyDictionary()
    _SHARED = _SharedThreads()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_begin_anew)


def _mailbox(loop: asyncio.AbstractEventLoop) -> _Mailbox:
    with _LOCK:
        mailbox = _MAILBOXES.get(loop)
        if mailbox is None:
            mailbox = _MAILBOXES[loop] = _Mailbox()
        return mailbox
