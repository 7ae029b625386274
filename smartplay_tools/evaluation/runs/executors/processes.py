"""The process executor: attempts in worker processes, for players that compute.

If a worker is killed, for example for its use of memory, only its attempt has failed. The episode continues from its
record in the next round.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path

from smartplay_tools.errors import InvalidArgumentError, TranscriptError
from smartplay_tools.evaluation.processes import Lost, ProcessPool
from smartplay_tools.evaluation.runs.attempt import Task, Times, play_attempt
from smartplay_tools.evaluation.runs.executors import Again, EndedAttempt, Executor, Take
from smartplay_tools.evaluation.runs.limits import Caps, SharedLimits
from smartplay_tools.evaluation.runs.run_progress import StopFlag
from smartplay_tools.transcript.file import append_exception


class ProcessExecutor(Executor):
    """Plays in `workers` processes."""

    def __init__(self, workers: int, caps: Caps, spent: tuple[int, float], stop: StopFlag) -> None:
        _check_main_module()
        super().__init__(workers, caps, spent, stop)
        self.limits = SharedLimits(caps, spent, processes=True) if caps else None

    def run(self, take: Take, again: Again) -> Iterator[EndedAttempt]:
        """Play the tasks, `workers` at a time."""
        with ProcessPool(partial(play_attempt, limits=self.limits, stop=self.stop), self._workers) as pool:
            for task, times in pool.run(take):
                if not isinstance(times, Lost):
                    yield EndedAttempt(task, times)
                    continue
                if not self.stop.is_set():
                    _check_begun(pool)
                    with suppress(TranscriptError):  # a record that cannot be read is set aside
                        append_exception(task.record, "The worker process died while it played this episode.")
                yield EndedAttempt(task, None)


def _check_begun(pool: ProcessPool[Task, Times]) -> None:
    """Refuse a program whose workers die before they have begun."""
    if not pool.has_begun:
        raise InvalidArgumentError(
            "No worker process could begin; its error is above. Workers import the program's main module: start the "
            'run below `if __name__ == "__main__":`, or pass executor="async" or executor="inline".'
        )


def _check_main_module() -> None:
    """Refuse a program that was read from standard input: workers could not import it."""
    main = sys.modules["__main__"]
    path = getattr(main, "__file__", None)
    if path is not None and getattr(main, "__spec__", None) is None and not Path(path).exists():
        raise InvalidArgumentError(
            f"Worker processes import the program's main module, and {path} is not a file: put the program into one, or"
            ' pass executor="async" or executor="inline".'
        )
