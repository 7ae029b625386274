"""Agents, which play episodes in their own way: a run hands them one at a time, and its record holds the outcome.

An agent calls a model itself or through an endpoint. So the cost of a call is reserved when the episode makes its
prompt; if the prompt is refused, the agent is told that the episode is over.
"""

from __future__ import annotations

import asyncio
import inspect
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias, runtime_checkable

from smartplay_tools.conversation.agent_session import AgentSession
from smartplay_tools.errors import SmartPlayError

if TYPE_CHECKING:
    from smartplay_tools.episode.episode import Episode
    from smartplay_tools.evaluation.runs.run_progress import StopFlag

LOOK_SECONDS = 0.1
"""Seconds between two checks whether an agent is done or the run stops."""

WAIT_SECONDS = 0.5
"""The same for an episode that others play: there may be hundreds, for hours."""

AgentFunction: TypeAlias = Callable[[AgentSession], Any] | Callable[["Episode"], Any]
"""Plays an episode; may be asynchronous. The name of its argument says what it takes.

`session` is an `AgentSession`, for its own loop. `episode` is the episode, for an adapter of this package, which
makes a session with the host's messages and tools in its head, or for a session with other arguments.
"""


class AgentFailedError(SmartPlayError):
    """An agent failed, or did not play at all."""


@dataclass(frozen=True)
class Held:
    """An episode that is handed over to an agent."""

    key: str
    episode: Episode
    session: AgentSession | None
    """The session of a record that is continued; None at the beginning of an episode."""
    stop: StopFlag
    """The agent returns when this is set."""

    @property
    def is_over(self) -> bool:
        """Whether the agent is to return: the episode has its result, or the run stops."""
        return self.episode.result is not None or self.stop.is_set()

    async def wait_for(self, playing: asyncio.Future[Any]) -> None:
        """Wait until the agent's task is done or the run stops."""
        while not playing.done() and not self.stop.is_set():
            await asyncio.wait([playing], timeout=LOOK_SECONDS)

    async def wait(self) -> None:
        """Wait until others have played the episode, or the run stops."""
        while not self.is_over:
            await asyncio.sleep(WAIT_SECONDS)

    def leave(self, why: str) -> None:
        """End the episode because its agent has stopped; an agent that never asked its model has failed."""
        if self.is_over:
            return
        if not self.episode.stats.turns and not self.episode.stats.tool_calls:
            raise AgentFailedError(f"{why} It has not asked its model.")
        self.episode.end("host", detail=why)


@runtime_checkable
class Agent(Protocol):
    """A program that plays episodes in its own way, while the model that it uses sees the game's window."""

    goes_on: bool
    """Whether an episode is continued from the record of an earlier attempt; otherwise it starts over."""

    async def play(self, held: Held) -> None:
        """Play an episode; return when it is over or the run stops. What is raised fails the attempt."""
        ...


class FunctionAgent:
    """An agent that is a function, which is called in its own thread or, if it is asynchronous, awaited."""

    goes_on = False

    def __init__(self, function: AgentFunction) -> None:
        self._function: Callable[[Any], Any] = function
        self._takes_session = argument_of(function) == "session"

    async def play(self, held: Held) -> None:
        """Call the function with the episode or its session; when the run stops, the episode is closed."""
        threads = ThreadPoolExecutor(1, "agent")
        given = AgentSession(held.episode) if self._takes_session else held.episode
        playing: asyncio.Future[Any] = (
            asyncio.ensure_future(self._function(given))
            if inspect.iscoroutinefunction(self._function)
            else asyncio.get_running_loop().run_in_executor(threads, self._function, given)
        )
        try:
            await held.wait_for(playing)
            if held.stop.is_set():
                held.episode.close()
                await asyncio.wait([playing])
                return
            playing.result()
            if held.episode.end_reason == "closed":
                raise AgentFailedError("The agent has closed its episode; leave that to the run.")
            held.leave("The agent has ended.")
        finally:
            threads.shutdown(wait=False)


def is_agent(function: Callable[..., Any]) -> bool:
    """Return whether a function plays an episode, as its argument says, and does not make a player."""
    return argument_of(function) in ("session", "episode")


def argument_of(function: Callable[..., Any]) -> str | None:
    """Return the name of a function's only argument; None if it has others, or cannot be looked at."""
    try:
        names = [*inspect.signature(function).parameters]
    except (TypeError, ValueError):
        return None
    return names[0] if len(names) == 1 else None
