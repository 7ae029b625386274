"""Work on the records of a run that several processes share, this one included: to replay or to show thousands.

Another process takes about a second to start, in which this one gets on. What comes of the work does not depend on the
number of processes, except for its order.
"""

from __future__ import annotations

import multiprocessing
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TypeVar

from smartplay_tools.games.specs import GAMES

LONGEST_CHUNK = 32
"""The most records that a process is handed at a time: with fewer, short ones would wait for being handed over."""

SHARES = 32
"""Into how many chunks for each process a few long records are split, so that all end at about the same time."""

T = TypeVar("T")
R = TypeVar("R")


@contextmanager
def sharing(work: Callable[[Sequence[T]], R], items: Sequence[T], processes: int) -> Iterator[Iterator[tuple[int, R]]]:
    """Do the work on chunks of the items; the value is an iterator over the results as they come, each with its number.

    The other processes begin at once, this one when the iterator is asked. `work` and the items must be picklable.
    """
    size = max(1, min(LONGEST_CHUNK, len(items) // (SHARES * processes)))
    chunks = [items[first : first + size] for first in range(0, len(items), size)]
    if processes < 2:
        yield ((number, work(chunk)) for number, chunk in enumerate(chunks))
        return
    pool = ProcessPoolExecutor(processes - 1, multiprocessing.get_context("spawn"))
    theirs: list[Future[R]] = []
    try:
        with suppress(BrokenProcessPool):  # the chunks that were handed over before stay in the list
            theirs.extend(pool.submit(work, chunk) for chunk in chunks)
        yield _results(work, chunks, theirs)
    finally:
        pool.shutdown(cancel_futures=True)


def _results(
    work: Callable[[Sequence[T]], R], chunks: Sequence[Sequence[T]], theirs: Sequence[Future[R]]
) -> Iterator[tuple[int, R]]:
    """Yield all results. The other processes begin at the first chunk, this one at the last."""
    for number in range(len(theirs), len(chunks)):
        yield number, work(chunks[number])
    left = deque(enumerate(theirs))
    while left and left[-1][1].cancel():
        number, _ = left.pop()
        yield number, work(chunks[number])
        while left and left[0][1].done():
            number, future = left.popleft()
            yield number, _result(future, work, chunks[number])
    for number, future in left:
        yield number, _result(future, work, chunks[number])


def _result(future: Future[R], work: Callable[[Sequence[T]], R], chunk: Sequence[T]) -> R:
    try:
        return future.result()
    except BrokenProcessPool:  # the others were killed, or could not begin; this process works on alone
        return work(chunk)


def worth(processes: int, records: Iterable[Path], size: int) -> int:
    """Return how many processes these records are worth: one for every `size` bytes, and at most `processes`.

    A record that its run has moved meanwhile counts as empty; it is missed when it is read.
    """
    total = 0
    for record in records if processes > 1 else ():
        with suppress(FileNotFoundError):
            total += record.stat().st_size
    return max(1, min(processes, total // size))


def others_know_the_games(*, plugins: bool = True) -> bool:
    """Return whether another process plays the same games as this one; `plugins`: it imports those of packages."""
    added = GAMES.added()
    return not added or (plugins and all(map(GAMES.is_declared, added)))
