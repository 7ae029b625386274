"""Functions: the game's three tools as Python callables, for frameworks that read names, annotations and docstrings."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, get_type_hints

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.types import ToolResult, ToolSpec

__all__ = ["AsyncGameTools", "GameTools", "tool_functions"]


class Callee(Protocol):
    """An object that answers the calls of the functions: an episode, or an adapter's object in front of one."""

    @property
    def tools(self) -> tuple[ToolSpec, ...]:
        """The tools: observe, act, read_manual."""
        ...

    def call(self, name: str, arguments: Any) -> ToolResult:
        """Answer a call."""
        ...


class AsyncCallee(Callee, Protocol):
    """An object that answers calls in threads, too, and says when it is over: an episode."""

    @property
    def done(self) -> bool:
        """Whether the episode is over."""
        ...

    async def acall(self, name: str, arguments: Any) -> ToolResult:
        """Answer a call in a thread."""
        ...

    def refuse_pictures(self, host: str) -> None:
        """Raise an `InvalidArgumentError` if results have pictures, which `host` cannot show."""
        ...


class _OfEpisode:
    def __init__(self, episode: AsyncCallee) -> None:
        episode.refuse_pictures("A function")
        self._episode = episode

    @property
    def done(self) -> bool:
        """Whether the episode is over."""
        return self._episode.done


class GameTools(_OfEpisode):
    """An object whose methods are the tools, for frameworks that take an object's public methods.

    `done` says whether the episode is over.
    """

    def observe(self) -> str:
        """Show the current observation again, without playing."""
        return self._episode.call("observe", {}).text

    def act(self, action: str) -> str:
        """Play one action and show what happens.

        Args:
            action: The action's name or number, exactly as listed.
        """
        return self._episode.call("act", {"action": action}).text

    def read_manual(self) -> str:
        """Show the game's manual."""
        return self._episode.call("read_manual", {}).text


class AsyncGameTools(_OfEpisode):
    """`GameTools` whose methods are awaited; the game's steps run in threads."""

    async def observe(self) -> str:
        """Show the current observation again, without playing."""
        return (await self._episode.acall("observe", {})).text

    async def act(self, action: str) -> str:
        """Play one action and show what happens.

        Args:
            action: The action's name or number, exactly as listed.
        """
        return (await self._episode.acall("act", {"action": action})).text

    async def read_manual(self) -> str:
        """Show the game's manual."""
        return (await self._episode.acall("read_manual", {})).text


def tool_functions(episode: Callee) -> tuple[Callable[[], str], Callable[[str], str], Callable[[], str]]:
    """Return the game's tools as plain functions, documented with the descriptions that this game's models are given.

    The tools of strategies are not among them: a framework that takes functions owns the context.
    """

    def observe() -> str:
        return episode.call("observe", {}).text

    def act(action: str) -> str:
        return episode.call("act", {"action": action}).text

    def read_manual() -> str:
        return episode.call("read_manual", {}).text

    described = {tool.name: tool for tool in episode.tools}
    for function in (observe, act, read_manual):
        if (tool := described.get(function.__name__)) is None:
            raise InvalidArgumentError(
                f"The functions are those of all three tools, and {function.__name__} is not offered; leave "
                'offered_tools at "all".'
            )
        function.__annotations__ = get_type_hints(function)  # types, not their names: what frameworks look at
        function.__doc__ = documentation(tool)
    return observe, act, read_manual


def documentation(tool: ToolSpec) -> str:
    """Return a tool's description and those of its arguments as a docstring."""
    properties: dict[str, Any] = tool.parameters["properties"]
    arguments = [f"    {name}: {field['description']}" for name, field in properties.items()]
    return "\n".join([tool.description, *(["\nArgs:", *arguments] if arguments else [])])
