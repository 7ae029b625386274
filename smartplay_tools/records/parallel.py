"""Process many records in parallel, using this process and a pool.

This process works while the others start. What comes of the work does not depend on the number of processes, except
for its order.
"""

from __future__ import annotations

import multiprocessing
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Generic, TypeVar

from smartplay_tools.games.specs import GAMES

LONGEST_CHUNK = 32
"""The most records that a process is handed at a time: with fewer, short ones would wait for being handed over."""

AHEAD = 3
"""The chunks that each other process has waiting or in work, so that it never waits for the next."""

SHARES = 32
"""The chunks for each process into which fewer records are split, so that all end at about the same time."""

T = TypeVar("T")
R = TypeVar("R")


@contextmanager
def parallel_map(
    work: Callable[[Sequence[T]], R], items: Sequence[T], processes: int
) -> Iterator[Iterator[tuple[int, R]]]:
    """Do the work on chunks of the items; the value is an iterator over pairs of a chunk's number and its result.

    They come as they are done. The other processes begin at once, this one when the iterator is asked. `work` and the
    items must be picklable.
    """
    size = max(1, min(LONGEST_CHUNK, len(items) // (SHARES * processes)))
    chunks = [items[first : first + size] for first in range(0, len(items), size)]
    if processes < 2:
        yield ((number, work(chunk)) for number, chunk in enumerate(chunks))
        return
    with ProcessPoolExecutor(processes - 1, multiprocessing.get_context("spawn")) as pool:
        shared = _Shared(pool, work, chunks)
        try:
            shared.begin(AHEAD * (processes - 1))
            yield shared.results()
        finally:
            shared.stop()


class _Shared(Generic[T, R]):
    """Chunks that other processes take from the front, each when one of its chunks is done, and this one from the end.

    While it works, this process takes nothing back that it has handed over: in Python 3.11, a pool in which a process
    dies fails over a future that was cancelled, and leaves its other processes behind.
    """

    def __init__(
        self, pool: ProcessPoolExecutor, work: Callable[[Sequence[T]], R], chunks: Sequence[Sequence[T]]
    ) -> None:
        self._pool, self._work, self._chunks = pool, work, chunks
        self._lock = threading.Lock()
        self._left = deque(range(len(chunks)))
        self._theirs: deque[tuple[int, Future[R]]] = deque()

    def begin(self, ahead: int) -> None:
        """Hand over the first chunks, one for each process."""
        for _ in range(ahead):
            self._hand_over()

    def _hand_over(self, done: Future[R] | None = None) -> None:
        """Hand the next chunk over; called in a thread of the pool when one is done."""
        if done is not None and (done.cancelled() or isinstance(done.exception(), BrokenProcessPool)):
            return  # from Python 3.12 on, a pool that is broken holds the lock that it needs to take more
        with self._lock:
            if not self._left:
                return
            number = self._left[0]
            try:
                future = self._pool.submit(self._work, self._chunks[number])
            except BrokenProcessPool:  # a process has died
                return
            self._theirs.append((self._left.popleft(), future))
        future.add_done_callback(self._hand_over)

    def results(self) -> Iterator[tuple[int, R]]:
        """Yield all results, those of this process between those of the others."""
        while (number := self._own()) is not None:
            yield number, self._work(self._chunks[number])
            while self._theirs and self._theirs[0][1].done():
                yield self._result(*self._theirs.popleft())
        while self._theirs:
            yield self._result(*self._theirs.popleft())

    def stop(self) -> None:
        """Begin no more chunks, because nobody wants the results."""
        with self._lock:
            self._left.clear()
        self._pool.shutdown(cancel_futures=True)

    def _own(self) -> int | None:
        with self._lock:
            return self._left.pop() if self._left else None

    def _result(self, number: int, future: Future[R]) -> tuple[int, R]:
        try:
            return number, future.result()
        except BrokenProcessPool:  # the others were killed, or could not begin; this process works on alone
            return number, self._work(self._chunks[number])


def worth(processes: int, records: Iterable[Path], size: int, *, plugins: bool = True) -> int:
    """Return how many processes these records are worth: one for every `size` bytes, and at most `processes`.

    Only this one is if it knows games that others do not; `plugins` says whether those import games of packages. A
    record that its run has moved meanwhile, or that cannot be read, counts as empty; reading it will say so.
    """
    if processes == 1 or not _others_know_the_games(plugins):
        return 1
    total = 0
    for record in records:
        with suppress(OSError):
            total += record.stat().st_size
    return max(1, min(processes, total // size))


def _others_know_the_games(plugins: bool) -> bool:
    added = GAMES.added()
    return not added or (plugins and all(map(GAMES.is_declared, added)))
