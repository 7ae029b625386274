"""The process executor: attempts in worker processes, for players that compute.

If a worker is killed, for example for its use of memory, only its task is lost. It continues from its record when there
is nothing else to play, alone; if its worker is killed again, the attempt has failed.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.processes import Lost, ProcessPool
from smartplay_tools.evaluation.runs.attempt import Task, Times, play_attempt
from smartplay_tools.evaluation.runs.executors import Again, EndedAttempt, Executor, Take
from smartplay_tools.evaluation.runs.limits import Caps, SharedLimits
from smartplay_tools.evaluation.runs.run_progress import StopFlag
from smartplay_tools.records.record import has_result
from smartplay_tools.transcript.file import append_exception


class ProcessExecutor(Executor):
    """Plays in `workers` processes."""

    def __init__(self, workers: int, caps: Caps, spent: tuple[int, float], stop: StopFlag) -> None:
        _check_main_module()
        super().__init__(workers, caps, spent, stop)
        self.limits = SharedLimits(caps, spent, processes=True) if caps else None

    def run(self, take: Take, again: Again) -> Iterator[EndedAttempt]:
        """Play the tasks, `workers` at a time; those whose worker died come last, one at a time."""
        play = partial(play_attempt, limits=self.limits, stop=self.stop)
        lost: list[Task] = []
        with ProcessPool(play, self._workers) as pool:
            while True:
                for task, times in pool.run(lambda: take() if pool.has_begun or not lost else None):
                    if not isinstance(times, Lost):
                        yield EndedAttempt(task, times)
                    elif has_result(task.record):
                        yield EndedAttempt(task, None)
                    else:
                        lost.append(task)
                if lost and not pool.has_begun and not self.stop.is_set():
                    raise InvalidArgumentError(
                        "No worker process could begin; its error is above. Workers import the program's main module:"
                        ' start the run below `if __name__ == "__main__":`, or pass executor="async" or'
                        ' executor="inline".'
                    )
                if not lost:
                    return
                while lost:
                    yield self._play_alone(pool, lost.pop(0), again)

    def _play_alone(self, pool: ProcessPool[Task, Times], task: Task, again: Again) -> EndedAttempt:
        if self.stop.is_set():
            return EndedAttempt(task, None)
        tasks = [again(task)]
        ((task, times),) = pool.run(lambda: tasks.pop() if tasks else None)
        if not isinstance(times, Lost):
            return EndedAttempt(task, times)
        append_exception(task.record, "The worker process died while it played this episode.")
        return EndedAttempt(task, None)


def _check_main_module() -> None:
    """Refuse a program that was read from standard input: workers could not import it."""
    main = sys.modules["__main__"]
    path = getattr(main, "__file__", None)
    if path is not None and getattr(main, "__spec__", None) is None and not Path(path).exists():
        raise InvalidArgumentError(
            f"Worker processes import the program's main module, and {path} is not a file: put the program into one, or"
            ' pass executor="async" or executor="inline".'
        )
