"""The progress of a run that is being played: one line that changes on a terminal, lines with the time elsewhere."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from smartplay_tools.evaluation.run_folder.follower import RunSnapshot, Spending
from smartplay_tools.evaluation.runs.run_progress import OnSnapshot
from smartplay_tools.terminal import Console, Text
from smartplay_tools.types.quantities import short

LOG_SECONDS = 60.0
"""Seconds after which a log gets another line."""


@contextmanager
def showing(console: Console) -> Iterator[OnSnapshot]:
    """Show the progress of a run: one line of figures on a terminal, elsewhere lines."""
    if console.is_terminal:
        with console.status("", spinner="line") as status:
            yield lambda snapshot: status.update(Text(snapshot.describe()))
    else:
        yield _Log(console)


class _Log:
    """Lines with the time: at the start, at every tenth, every minute and the end."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._tenth, self._last, self._words = -1, 0.0, ""

    def __call__(self, snapshot: RunSnapshot) -> None:
        """Log what has changed since the last snapshot."""
        tenth = 10 * snapshot.finished // max(1, snapshot.planned)
        is_due = time.monotonic() - self._last >= LOG_SECONDS
        if tenth > self._tenth or is_due or (not snapshot.running and snapshot.describe() != self._words):
            self._tenth, self._last, self._words = tenth, time.monotonic(), snapshot.describe()
            self._console.print(f"{time.strftime('%H:%M:%S')} {self._words}", highlight=False, soft_wrap=True)


def spending_sentences(spending: Spending) -> list[str]:
    """Return a sentence about what a run has used in all, if any of it is not in its results or costs money."""
    total, others = spending.total, spending.other_attempts
    if not (others.tokens or others.unknown_calls or total.cost):
        return []
    sentence = f"Spent in all: {short(total.tokens)} tokens{_dollars(total.cost)}"
    if others.tokens:
        sentence += f", of them {short(others.tokens)} tokens{_dollars(others.cost)} in attempts without a result"
    if total.unknown_calls:
        calls = "1 call was" if total.unknown_calls == 1 else f"{total.unknown_calls} calls were"
        most = f"at most {short(total.unknown_tokens)} tokens{_dollars(total.unknown_cost)}"
        sentence += f". {calls} under way when the run or a worker stopped; whether they are charged is unknown, {most}"
    return [sentence + "."]


def _dollars(cost: float | None) -> str:
    return ", cost unknown" if cost is None else f", ${cost:.2f}" if cost else ""
