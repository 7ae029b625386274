"""The asynchronous executor: many attempts on one event loop, for players that wait on a model.

Hundreds of episodes run in one process; steps of slow games run in threads. Each episode has at most one request at a
time, so the number of concurrent episodes limits the concurrent requests. Failed requests are retried by the player,
which counts every attempt in its usage.

Players that serve many conversations (`serves_many`) are created once for each cell and share their connections.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterable, Iterator
from contextlib import AsyncExitStack

from smartplay_tools.evaluation.processes import POLL_SECONDS
from smartplay_tools.evaluation.runs.attempt import Task, aplay_attempt, make_player
from smartplay_tools.evaluation.runs.executors import Again, EndedAttempt, Executor, Take
from smartplay_tools.players.opening import aenter_player
from smartplay_tools.types import AsyncPlayer

GRACE_SECONDS = 10.0
"""Seconds to wait for open requests when the run stops, because their replies are paid for."""


class AsyncExecutor(Executor):
    """Plays `workers` episodes at a time on its own event loop."""

    def run(self, take: Take, again: Again) -> Iterator[EndedAttempt]:
        """Play the tasks, `workers` at a time."""
        self._shared: dict[str, AsyncPlayer | None] = {}  # those of an earlier call are closed
        with asyncio.Runner() as runner:
            loop, closing = runner.get_loop(), AsyncExitStack()
            under_way: set[asyncio.Task[EndedAttempt]] = set()
            try:
                while True:
                    while len(under_way) < self._workers and (task := take()) is not None:
                        under_way.add(loop.create_task(self._play(task, closing)))
                    if not under_way:
                        return
                    for done in runner.run(self._first(under_way)):
                        under_way.remove(done)
                        yield done.result()
            finally:  # an error, or a caller that wants no more, ends the attempts that are under way
                runner.run(_end(under_way, closing))

    async def _first(self, under_way: set[asyncio.Task[EndedAttempt]]) -> set[asyncio.Task[EndedAttempt]]:
        """Return the finished attempts, as soon as there is one or it is time to look for tasks and the flag again."""
        done, _ = await asyncio.wait(under_way, timeout=POLL_SECONDS, return_when=asyncio.FIRST_COMPLETED)
        if self.stop.is_set():
            _, late = await asyncio.wait(under_way, timeout=GRACE_SECONDS)
            for task in late:
                task.cancel()
            done, _ = await asyncio.wait(under_way)
        return done

    async def _play(self, task: Task, closing: AsyncExitStack) -> EndedAttempt:
        shared = None if task.player.agent is not None else await self._player(task, closing)
        return EndedAttempt(task, await aplay_attempt(task, self.limits, self.stop, shared))

    async def _player(self, task: Task, closing: AsyncExitStack) -> AsyncPlayer | None:
        """The player that the attempts of a cell share; None if each needs its own."""
        cell = task.planned.cell
        name = str([cell.player, sorted(cell.player_options.items()), task.player.api_key_env])
        if name not in self._shared:
            self._shared[name] = player = _shareable(task)
            if player is not None:
                await aenter_player(closing, player)
        return self._shared[name]


async def _end(under_way: Iterable[asyncio.Task[EndedAttempt]], closing: AsyncExitStack) -> None:
    """Cancel attempts, which keep what they have recorded, and close the players; further errors are not raised."""
    for task in under_way:
        task.cancel()
    await asyncio.gather(*under_way, return_exceptions=True)
    await closing.aclose()


def _shareable(task: Task) -> AsyncPlayer | None:
    try:
        player = make_player(task)
    except Exception:
        # The attempts will fail with the same error, and record it.
        return None
    return player if isinstance(player, AsyncPlayer) and getattr(player, "serves_many", False) else None
