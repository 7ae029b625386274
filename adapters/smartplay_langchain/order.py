"""TurnOrder: plays the calls of one reply in the order of the message, whatever order a tool node runs them in.

LangGraph runs the calls of a message at once, in threads or tasks, and other middlewares may stop, edit or answer any
of them. A call therefore waits for the calls before it. If one of those does not come (a person is still to approve
it), the call is held: its tool returns a provisional message, and it is played as soon as the others are decided.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, wait as wait_for
from contextlib import contextmanager

PATIENCE = 1.0
"""Seconds that a call waits for an earlier one that has not begun, before it is held; no result depends on it."""


class TurnOrder:
    """The calls of one reply that wait, and those that are being played.

    Arguments:
        earlier_open: returns the positions of the calls before a position that are not answered yet.
    """

    def __init__(self, earlier_open: Callable[[int], set[int]]) -> None:
        self._earlier_open = earlier_open
        self._lock = threading.Lock()
        self._playing: set[int] = set()
        self._held: set[int] = set()
        self._waiting: list[tuple[int, Future[bool]]] = []

    def begin(self, position: int) -> bool:
        """Wait for the calls before a position; whether the call may be played now. If not, it is held."""
        with self._asking(position) as future:
            while not future.done():
                wait_for([future], timeout=PATIENCE)
                self._give_up(position, future)
            return future.result()

    async def abegin(self, position: int) -> bool:
        """Wait as `begin` does, without blocking the event loop."""
        with self._asking(position) as future:
            while not future.done():
                await asyncio.wait([asyncio.wrap_future(future)], timeout=PATIENCE)
                self._give_up(position, future)
            return future.result()

    def end(self, position: int) -> None:
        """Note that a call has been answered, and wake those that waited for it."""
        with self._lock:
            self._playing.discard(position)
            self._decide_all()

    @contextmanager
    def _asking(self, position: int) -> Iterator[Future[bool]]:
        """Ask whether a call may be played. One that is cancelled while it waits is not played, nor waited for."""
        future: Future[bool] = Future()
        with self._lock:
            self._decide(position, future)
        try:
            yield future
        except BaseException:
            with self._lock:
                self._playing.discard(position)
                self._waiting = [each for each in self._waiting if each[1] is not future]
            raise

    def _decide_all(self) -> None:
        waiting, self._waiting = self._waiting, []
        for position, future in waiting:
            self._decide(position, future)

    def _decide(self, position: int, future: Future[bool]) -> None:
        """Resolve the future if it is known whether the call may be played."""
        earlier = self._earlier_open(position)
        if position in self._held or earlier & self._held:
            self._held.add(position)
            future.set_result(False)
        elif not earlier:
            self._playing.add(position)
            future.set_result(True)
        else:
            self._waiting.append((position, future))

    def _give_up(self, position: int, future: Future[bool]) -> None:
        """Hold a call that has waited long enough, unless an earlier call is being played at this moment."""
        with self._lock:
            if future.done() or self._playing & self._earlier_open(position):
                return
            self._held.add(position)
            self._decide_all()
