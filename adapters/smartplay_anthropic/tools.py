"""The tools of an episode for the `tool_runner` of the `anthropic` client, which calls tools by itself.

    runner = client.beta.messages.tool_runner(model=..., max_tokens=1024, messages=[...], tools=tools(episode))
    runner.until_done()

A runner manages the context, so the episode needs `context="host"`. The model gets a refused call as a result with
`is_error`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from anthropic.lib.tools import BetaAsyncBuiltinFunctionTool, BetaBuiltinFunctionTool, ToolError

from smartplay_tools import Episode, InvalidArgumentError, ToolResult, ToolSpec, schema


class EpisodeTool(BetaBuiltinFunctionTool):
    """A tool of an episode; its schema is passed on unchanged, and the episode validates the arguments."""

    def __init__(self, episode: Episode, spec: ToolSpec) -> None:
        self._episode, self._spec = episode, spec

    def to_dict(self) -> Any:
        """Return the tool in the form that requests have."""
        return schema(self._spec, "anthropic")

    def call(self, input: object) -> str:  # noqa: A002 - the client's name for it
        """Play a call; raise `ToolError` if it is refused."""
        return _text(self._episode.call(self._spec.name, _arguments(input)))


class AsyncEpisodeTool(BetaAsyncBuiltinFunctionTool):
    """A tool of an episode for `AsyncAnthropic`; the game is played in a thread."""

    def __init__(self, episode: Episode, spec: ToolSpec) -> None:
        self._episode, self._spec = episode, spec

    def to_dict(self) -> Any:
        """Return the tool in the form that requests have."""
        return schema(self._spec, "anthropic")

    async def call(self, input: object) -> str:  # noqa: A002 - the client's name for it
        """Play a call; raise `ToolError` if it is refused."""
        return _text(await self._episode.acall(self._spec.name, _arguments(input)))


def tools(episode: Episode) -> list[EpisodeTool]:
    """Return the tools of an episode for `Anthropic().beta.messages.tool_runner`."""
    _check(episode)
    return [EpisodeTool(episode, spec) for spec in episode.tools]


def async_tools(episode: Episode) -> list[AsyncEpisodeTool]:
    """Return the tools of an episode for `AsyncAnthropic().beta.messages.tool_runner`."""
    _check(episode)
    return [AsyncEpisodeTool(episode, spec) for spec in episode.tools]


def _check(episode: Episode) -> None:
    if episode.config.context != "host":
        raise InvalidArgumentError('A tool runner manages the context; make the episode with context="host".')
    episode.refuse_pictures("This tool runner")


def _arguments(sent: object) -> Any:
    return dict(sent) if isinstance(sent, Mapping) else sent


def _text(result: ToolResult) -> str:
    if result.is_error:
        raise ToolError(result.text)
    return result.text
