"""Process many records in parallel, using this process and a pool.

This process works while the others start. The results do not depend on the number of processes, except for their order.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from queue import SimpleQueue
from typing import Generic, TypeVar

from smartplay_tools.evaluation.processes import Lost, ProcessPool
from smartplay_tools.games.specs import GAMES

LONGEST_CHUNK = 32
"""The most records in a chunk. With fewer, processes would wait for their next chunk when records are short."""

SHARES = 32
"""The chunks for each process into which fewer records are split, so that all end at about the same time."""

T = TypeVar("T")
R = TypeVar("R")


@contextmanager
def parallel_map(
    work: Callable[[Sequence[T]], R], items: Sequence[T], processes: int
) -> Iterator[Iterator[tuple[int, R]]]:
    """Do the work on chunks of the items; the value is an iterator over pairs of a chunk's number and its result.

    Results come in the order of completion. The other processes begin at once, this one when the iterator is first
    used. `work` and the items must be picklable.
    """
    size = max(1, min(LONGEST_CHUNK, len(items) // (SHARES * processes)))
    chunks = [items[first : first + size] for first in range(0, len(items), size)]
    if processes < 2:
        yield ((number, work(chunk)) for number, chunk in enumerate(chunks))
        return
    shared = _Shared(work, chunks)
    others = threading.Thread(target=shared.hand_over, args=(processes - 1,))
    others.start()
    try:
        yield shared.results()
    finally:
        shared.stop()
        others.join()


class _Shared(Generic[T, R]):
    """Chunks that other processes take from the front, handed over by a thread, and this one from the end."""

    def __init__(self, work: Callable[[Sequence[T]], R], chunks: Sequence[Sequence[T]]) -> None:
        self._work, self._chunks = work, chunks
        self._left = deque(range(len(chunks)))
        self._theirs: SimpleQueue[tuple[int, R | Lost] | BaseException] = SimpleQueue()

    def hand_over(self, processes: int) -> None:
        """Have other processes work until nothing is left, or one of them dies: then this one goes on alone."""
        all_live = True

        def take() -> tuple[int, Sequence[T]] | None:
            number = self._next(self._left.popleft) if all_live else None
            return None if number is None else (number, self._chunks[number])

        try:
            with ProcessPool(partial(_work_on, self._work), processes) as pool:
                for (number, _), result in pool.run(take):
                    all_live = all_live and not isinstance(result, Lost)
                    self._theirs.put((number, result))
        except BaseException as error:
            self._theirs.put(error)

    def results(self) -> Iterator[tuple[int, R]]:
        """Yield all results, those of this process between those of the others."""
        for _ in self._chunks:
            number = self._next(self._left.pop) if self._theirs.empty() else None
            if number is None:
                done = self._theirs.get()
                if isinstance(done, BaseException):
                    raise done
                number, result = done
                if not isinstance(result, Lost):
                    yield number, result
                    continue
            yield number, self._work(self._chunks[number])

    def stop(self) -> None:
        """Begin no more chunks, because nobody wants the results."""
        self._left.clear()

    @staticmethod
    def _next(pop: Callable[[], int]) -> int | None:
        with suppress(IndexError):  # the other thread was faster
            return pop()
        return None


def _work_on(work: Callable[[Sequence[T]], R], job: tuple[int, Sequence[T]]) -> R:
    return work(job[1])


def worth(processes: int, records: Iterable[Path], size: int, *, plugins: bool = True) -> int:
    """Return how many processes these records are worth: one for every `size` bytes, and at most `processes`.

    Only this process is used if it has games that others would not have; `plugins`: these import games of packages. A
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
