"""TurnOrder: plays the calls of one reply in the order of the message, whatever order a tool node runs them in.

LangGraph runs the calls of a message at once, in threads or tasks, and other middlewares may stop, edit or answer any
of them. A call therefore waits for the calls before it. If one of those does not come (a person is still to approve
it), the call is held: its tool returns a provisional message, and it is played as soon as the others are decided.
"""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable

PATIENCE = 1.0
"""Seconds that a call waits for an earlier one that has not begun, before it is held; no result depends on it."""

PAUSE = 0.005
"""Seconds after which a call that waits looks again."""


class TurnOrder:
    """The calls of one reply that are being played, and those that are held.

    Arguments:
        earlier_open: returns the positions of the calls before a position that are not answered yet.
    """

    def __init__(self, earlier_open: Callable[[int], set[int]]) -> None:
        self._earlier_open = earlier_open
        self._lock = threading.Lock()
        self._playing: set[int] = set()
        self._held: set[int] = set()
        self._ended = 0.0
        """When a call was last answered: the next one has time to begin."""

    def begin(self, position: int) -> bool:
        """Wait for the calls before a position; whether the call may be played now. If not, it is held."""
        begun = time.monotonic()
        while (decision := self._decide(position, begun)) is None:
            time.sleep(PAUSE)
        return decision

    async def abegin(self, position: int) -> bool:
        """Wait as `begin` does, without blocking the event loop."""
        begun = time.monotonic()
        while (decision := self._decide(position, begun)) is None:
            await asyncio.sleep(PAUSE)
        return decision

    def end(self, position: int) -> None:
        """Note that a call has been answered."""
        with self._lock:
            self._playing.discard(position)
            self._ended = time.monotonic()

    def _decide(self, position: int, begun: float) -> bool | None:
        """Whether a call that has waited since a time may be played; None while that is not known."""
        with self._lock:
            earlier = self._earlier_open(position)
            is_tired = time.monotonic() - max(begun, self._ended) > PATIENCE and not self._playing & earlier
            if position in self._held or earlier & self._held or (earlier and is_tired):
                self._held.add(position)
                return False
            if earlier:
                return None
            self._playing.add(position)
            return True
