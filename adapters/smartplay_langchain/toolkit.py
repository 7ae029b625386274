"""The three tools as LangChain tools, for any LangChain agent.

A tool passes its arguments to the episode, which validates them. The content of its message is the result's text; its
artifact is the result's data, which the model does not see. With these tools alone the agent owns the context: the
window and the token budgets are enforced by `SmartPlayMiddleware` and `GraphSession`, not here.

With `pictures=True` a result with a picture has content blocks, its text and the picture. What a model makes of an
image in a tool's message depends on its package: OpenAI's sends it on to chat completions, which refuse it there.
"""

from __future__ import annotations

from typing import Any

from langchain_core.messages import ToolMessage
from langchain_core.runnables import RunnableConfig
from langchain_core.tools import BaseTool, BaseToolkit
from pydantic import ConfigDict, Field

from smartplay_langchain.messages import image_block
from smartplay_tools import Episode, ToolResult, schema

Content = str | list[str | dict[Any, Any]]
"""The content of a message: text, or content blocks."""


class SmartPlayTool(BaseTool):
    """One of the tools of an episode. Errors are messages with `status="error"`; their artifact is kept."""

    episode: Episode = Field(exclude=True, repr=False)
    response_format: Any = "content_and_artifact"

    def invoke(self, input: Any, config: RunnableConfig | None = None, **kwargs: Any) -> Any:  # noqa: A002
        """Call the tool; a `ToolCall` gives a `ToolMessage`, plain arguments give the text."""
        return _with_status(super().invoke(input, config, **kwargs))

    async def ainvoke(self, input: Any, config: RunnableConfig | None = None, **kwargs: Any) -> Any:  # noqa: A002
        """Call the tool as `invoke` does, without blocking the event loop."""
        return _with_status(await super().ainvoke(input, config, **kwargs))

    def _run(self, /, *_: Any, **arguments: Any) -> tuple[Content, dict[str, Any]]:
        return _answer(self.episode.call(self.name, arguments))

    async def _arun(self, /, *_: Any, **arguments: Any) -> tuple[Content, dict[str, Any]]:
        return _answer(await self.episode.acall(self.name, arguments))


class SmartPlayToolkit(BaseToolkit):
    """The tools of an episode; with `context="host"` its `observe` shows the history, too."""

    model_config = ConfigDict(arbitrary_types_allowed=True)

    episode: Episode = Field(exclude=True, repr=False)
    pictures: bool = False
    """Whether the agent's model sees pictures in results; without it, an episode that has pictures is refused."""

    def get_tools(self) -> list[BaseTool]:
        """Return observe, act and read_manual."""
        if not self.pictures:
            self.episode.refuse_pictures("This toolkit", has_option=True)
        tools = [schema(tool, "json") for tool in self.episode.tools]
        return [
            SmartPlayTool(
                name=tool["name"],
                description=tool["description"],
                args_schema=tool["parameters"],
                episode=self.episode,
            )
            for tool in tools
        ]


def _answer(result: ToolResult) -> tuple[Content, dict[str, Any]]:
    content: Content = result.text
    if (picture := result.picture) is not None:
        content = [{"type": "text", "text": result.text}, image_block(picture)]
    return content, artifact_of(result)


def artifact_of(result: ToolResult) -> dict[str, Any]:
    """Return the artifact of a result's message."""
    return {**result.data, "is_error": result.is_error, "done": result.done}


def is_of_a_game(message: ToolMessage) -> bool:
    """Whether a message has the artifact of a game's result."""
    return isinstance(message.artifact, dict) and {"is_error", "done"} <= message.artifact.keys()


def _with_status(output: Any) -> Any:
    if isinstance(output, ToolMessage) and output.artifact and output.artifact.get("is_error"):
        output.status = "error"
    return output
