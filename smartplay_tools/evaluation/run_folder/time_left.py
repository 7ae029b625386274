"""The time that a run is expected to take from now on, at the rate so far.

The rate is that of the calls, tokens and dollars since the first look, so a run that is continued has its own. Near the
end, when a few long episodes are played alone, the run takes longer than its rate says.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

Clock = Callable[[], float]

Amounts = Mapping[str, tuple[float | None, float | None]]
"""What the run has used, by name, and how much it can or is expected to use; None for what is not known."""


class TimeLeft:
    """Estimates the time left of a run, from looks at its progress."""

    def __init__(self, clock: Clock = time.monotonic) -> None:
        self._clock = clock
        self._first: tuple[float, Amounts] | None = None

    def look(self, amounts: Amounts) -> float | None:
        """Return the seconds until the first amount reaches its limit; None as long as no rate is known."""
        now = self._clock()
        began, first = self._first = self._first or (now, amounts)
        left = [
            max(0.0, limit - amount) * (now - began) / (amount - before)
            for name, (amount, limit) in amounts.items()
            if amount is not None and limit is not None and (before := first[name][0]) is not None and amount > before
        ]
        return min(left, default=None)
