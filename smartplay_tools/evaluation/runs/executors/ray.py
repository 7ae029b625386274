"""The Ray executor: attempts on the machines of a Ray cluster, each of which has this package installed.

No disk is shared. Before each call to the player and after each reply, an attempt sends the new lines of its record to
an actor on this process's machine, from which this process writes them into the run's folder; the next call waits until
the actor has them. If a worker or its machine is lost, no received reply is lost, and the episode continues from its
record on another machine. The actor then refuses the lines of the lost worker, which may live on for a moment, so that
it makes no further call. If the actor cannot be reached for a moment, Ray repeats the call: lines are sent and taken
with their place in the record, so that none is written twice.

The executor joins the cluster that `RAY_ADDRESS` names, or starts one on this machine. A cluster that it started, and
the limits in it, exist until the executor is closed, so failed attempts are retried in the same cluster.
"""

from __future__ import annotations

import dataclasses
import os
import tempfile
from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from pathlib import Path
from typing import Any

from smartplay_tools.errors import EngineError, extra_named
from smartplay_tools.evaluation.processes import POLL_SECONDS
from smartplay_tools.evaluation.runs.attempt import StoppedError, Task, Times, play_attempt
from smartplay_tools.evaluation.runs.executors import Again, EndedAttempt, Executor, Take
from smartplay_tools.evaluation.runs.limits import Caps, RunLimits, SharedLimits
from smartplay_tools.evaluation.runs.run_progress import StopFlag
from smartplay_tools.records.record import has_result
from smartplay_tools.transcript.file import append_exception

with extra_named("The Ray executor", "ray"):
    import ray
    from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

WORKER_LOSSES = 3
"""How often, in one run, an episode is continued in another worker after its worker was lost."""


@dataclasses.dataclass(frozen=True)
class _RayAttempt:
    """An attempt that is under way. Its number is its own, while an attempt that left no record gives its name away."""

    number: int
    task: Task


class RayExecutor(Executor):
    """Plays `workers` episodes at a time, each on a processor of the cluster."""

    def __init__(self, workers: int, caps: Caps, spent: tuple[int, float], stop: StopFlag) -> None:
        super().__init__(workers, caps, spent, stop)
        self._own = not ray.is_initialized()
        if self._own:
            _connect(workers)
        if caps:
            self.limits = _RemoteLimits(_actor(SharedLimits).remote(caps, spent))
        self._records = _actor(_Records, max_task_retries=-1).remote()
        self._batch = self._begun = 0
        self._play = ray.remote(max_retries=0, num_cpus=1)(_play)

    def run(self, take: Take, again: Again) -> Iterator[EndedAttempt]:
        """Play the tasks, `workers` at a time; those whose worker was lost continue on another one."""
        try:
            yield from self._run(take, again)
        except ray.exceptions.RayError as error:
            raise EngineError(f"The Ray cluster has lost what this run needs ({type(error).__name__}).") from error

    def _run(self, take: Take, again: Again) -> Iterator[EndedAttempt]:
        under_way: dict[Any, _RayAttempt] = {}
        losses: Counter[str] = Counter()
        while True:
            while len(under_way) <= self._workers and (task := take()) is not None:
                self._begin(task, under_way)
            if not under_way:
                return
            done, _ = ray.wait(list(under_way), num_returns=1, timeout=POLL_SECONDS)
            self._write_records(under_way.values())
            for reference in done:
                attempt = under_way.pop(reference)
                task = attempt.task
                outcome = _outcome(reference, task)
                if outcome is None:
                    self._give_up([attempt], under_way.values())
                if outcome is None and has_result(task.record):
                    outcome = EndedAttempt(task, None)
                if outcome is None and losses[task.planned.key] < WORKER_LOSSES and not self.stop.is_set():
                    losses[task.planned.key] += 1
                    self._begin(again(task), under_way)
                else:
                    yield outcome or _given_up(task)
            if self.stop.is_set():
                yield from self._cancel(under_way)
                return

    def close(self) -> None:
        """Leave the cluster if this executor has joined or started it."""
        if self._own:
            ray.shutdown()

    def _begin(self, task: Task, under_way: dict[Any, _RayAttempt]) -> None:
        self._begun += 1
        previous = None if task.previous is None else task.previous.read_bytes()
        reference = self._play.remote(task, previous, self.limits, self._records, self._begun, Path.cwd())
        under_way[reference] = _RayAttempt(self._begun, task)

    def _write_records(self, attempts: Iterable[_RayAttempt]) -> None:
        """Write the received parts of these attempts' records; all that are under way have to be among them."""
        paths = {attempt.number: attempt.task.record for attempt in attempts}
        self._batch, texts = ray.get(self._records.take.remote(self._batch, set(paths)))
        for number in paths.keys() & texts.keys():
            with paths[number].open("ab") as record:
                record.write(texts[number])

    def _give_up(self, lost: Collection[_RayAttempt], others: Iterable[_RayAttempt]) -> None:
        """Refuse further lines of these attempts, and write what has arrived of them and of the others."""
        for attempt in lost:
            ray.get(self._records.give_up.remote(attempt.number))
        self._write_records([*lost, *others])

    def _cancel(self, under_way: dict[Any, _RayAttempt]) -> Iterator[EndedAttempt]:
        for reference in under_way:
            ray.cancel(reference, force=True)
        ray.wait(list(under_way), num_returns=len(under_way), timeout=10)
        self._give_up(under_way.values(), ())
        for attempt in under_way.values():
            yield EndedAttempt(attempt.task, None)


def _connect(workers: int) -> None:
    """Join the named cluster, or start one with a processor for each worker."""
    how: dict[str, Any] = {"log_to_driver": False, "configure_logging": False}
    if not os.environ.get("RAY_ADDRESS"):
        how |= {"address": "local", "num_cpus": workers, "include_dashboard": False}
    ray.init(**how)


def _actor(kind: Any, **options: Any) -> Any:
    """An actor on this machine, which exists as long as the run.

    Ray lets any machine place an actor that needs no resources, and a machine that has just joined may not know this
    one and keep the actor. An actor that needs a byte is placed by the machine that asks for it.
    """
    here = NodeAffinitySchedulingStrategy(ray.get_runtime_context().get_node_id(), soft=False)
    return ray.remote(kind).options(num_cpus=0, memory=1, scheduling_strategy=here, **options)


class _Records:
    """In an actor: the new lines of attempts' records that have not been written yet.

    A call that Ray repeats changes nothing, because every text comes with its place and every batch with its number.
    """

    def __init__(self) -> None:
        self._lengths: dict[int, int] = {}
        self._given_up: set[int] = set()
        self._new: dict[int, bytes] = {}
        self._taken: dict[int, bytes] = {}
        self._batch = 0

    def add(self, number: int, start: int, text: bytes) -> bool:
        """Add the text of an attempt's record from byte `start` on; return whether the attempt was not given up."""
        if number in self._given_up:
            return False
        length = self._lengths.get(number, 0)
        self._lengths[number] = start + len(text)
        self._new[number] = self._new.get(number, b"") + text[length - start :]
        return True

    def give_up(self, number: int) -> None:
        """Refuse further texts of an attempt: its worker was lost."""
        self._given_up.add(number)

    def take(self, written: int, playing: Collection[int]) -> tuple[int, dict[int, bytes]]:
        """Return the next batch of texts and its number, where `written` is the number of the last one that arrived."""
        if written == self._batch:
            self._batch, self._taken = self._batch + 1, {}
        for number, text in self._new.items():
            self._taken[number] = self._taken.get(number, b"") + text
        self._new = {}
        self._lengths = {number: length for number, length in self._lengths.items() if number in playing}
        return self._batch, self._taken


class _RemoteLimits:
    """The run's limits, which are kept in an actor; picklable."""

    def __init__(self, actor: Any) -> None:
        self._actor = actor

    def reserve(self, tokens: int, cost: float) -> bool:
        return bool(ray.get(self._actor.reserve.remote(tokens, cost)))

    def settle(self, reserved: tuple[int, float], spent: tuple[int, float]) -> None:
        ray.get(self._actor.settle.remote(reserved, spent))


def _play(
    task: Task, previous: bytes | None, limits: RunLimits | None, records: Any, number: int, working: Path
) -> Times:
    """On a machine of the cluster: play, and send the record as it grows.

    `working` is the folder to work in, so that a relative path of a file of the user's leads where it leads the user.
    """
    if working.is_dir():
        os.chdir(working)
    with tempfile.TemporaryDirectory() as folder:
        record = Path(folder) / task.record.name
        sent = 0

        def send() -> None:
            nonlocal sent
            if record.exists() and record.stat().st_size > sent:
                with record.open("rb") as file:
                    file.seek(sent)
                    text = file.read()
                if not ray.get(records.add.remote(number, sent, text)):
                    raise StoppedError
                sent += len(text)

        earlier = None if previous is None else Path(folder) / "earlier.jsonl"
        if earlier is not None and previous is not None:
            earlier.write_bytes(previous)
        elsewhere = dataclasses.replace(task, record=record, previous=earlier)
        times = play_attempt(elsewhere, limits, StopFlag(), on_record=send)
        send()
        return times


_LOST = (
    ray.exceptions.LocalRayletDiedError,
    ray.exceptions.NodeDiedError,
    ray.exceptions.ObjectLostError,
    ray.exceptions.WorkerCrashedError,
)
"""The errors that say that a worker or its machine was lost, and not that the attempt failed."""


def _outcome(reference: Any, task: Task) -> EndedAttempt | None:
    """The outcome of an attempt; None if its worker was lost."""
    try:
        return EndedAttempt(task, ray.get(reference))
    except _LOST:
        return None
    except ray.exceptions.RayError as error:
        append_exception(task.record, f"{type(error).__name__}: {error}")
        return EndedAttempt(task, None)


def _given_up(task: Task) -> EndedAttempt:
    append_exception(task.record, f"The worker that played this episode was lost, {WORKER_LOSSES + 1} times.")
    return EndedAttempt(task, None)
