"""A hosted episode: an episode played by an external agent, one call at a time, in the order of arrival."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from smartplay_tools.errors import InvalidArgumentError

if TYPE_CHECKING:
    from smartplay_tools.episode.episode import Episode
    from smartplay_tools.types import ToolResult

LONG = 0.005
"""Seconds for which the event loop may be blocked."""

NOT_ENFORCEABLE = ("prompt_tokens", "reply_tokens", "episode_tokens", "episode_cost", "cost_rule", "slack")
"""Budgets for prompts and replies, which only the host could enforce."""


class HostedEpisode:
    """An episode and its lock.

    A fast game is played on the event loop, because the switch to a thread would take longer than its step.

    Arguments:
        episode: the episode, or a function that makes it: it is called in a thread, because a game may take longer to
            load than a host waits for a server's first word.
    """

    def __init__(self, episode: Episode | Callable[[], Episode]) -> None:
        self._make = episode if callable(episode) else None
        self._making: asyncio.Future[Episode] | None = None
        self._episode = None if callable(episode) else checked(episode)
        self._turn = asyncio.Lock()
        self._seconds = 0.0
        """Seconds that the latest call took."""

    @property
    def episode(self) -> Episode:
        """The episode; one that is still being made is there once `ready` has been awaited."""
        assert self._episode is not None
        return self._episode

    async def ready(self) -> Episode:
        """Return the episode, made if it has to be."""
        if self._episode is None:
            assert self._make is not None
            if self._making is None:
                self._making = asyncio.ensure_future(asyncio.to_thread(self._make))
            self._episode = checked(await asyncio.shield(self._making))
        return self._episode

    async def call(self, name: str, arguments: Any, call_id: str | None = None) -> ToolResult:
        """Play a call after all earlier ones; in a thread if the latest one took long."""
        episode = await self.ready()
        async with self._turn:
            begun = time.perf_counter()
            if self._seconds > LONG:
                result = await asyncio.to_thread(episode.call, name, arguments, call_id)
            else:
                result = episode.call(name, arguments, call_id)
            self._seconds = time.perf_counter() - begun
            return result


def checked(episode: Episode) -> Episode:
    """Return an episode that an MCP host can play; `InvalidArgumentError` for any other."""
    if episode.config.context != "host":
        raise InvalidArgumentError('An MCP host manages the context; make the episode with context="host".')
    if episode.config.manual == "pinned":
        raise InvalidArgumentError(
            'An MCP host shows the results of tools only, so the manual cannot be pinned; leave manual="tool".'
        )
    if unenforceable := [name for name in NOT_ENFORCEABLE if getattr(episode.budget, name)]:
        raise InvalidArgumentError(
            f"An MCP host manages the context, so the budget cannot have {', '.join(unenforceable)}; "
            "history, result_tokens and tool_calls are enforced."
        )
    return episode
