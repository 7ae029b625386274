"""Players both ways: a LangChain chat model that plays, and a player of this package as a LangChain chat model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from langchain_core.callbacks import CallbackManagerForLLMRun
from langchain_core.language_models import BaseChatModel, LanguageModelInput
from langchain_core.messages import AIMessage, BaseMessage
from langchain_core.outputs import ChatGeneration, ChatResult
from langchain_core.runnables import Runnable
from langchain_core.utils.function_calling import convert_to_openai_tool
from pydantic import ConfigDict, Field

from smartplay_langchain.messages import from_langchain, to_langchain, usage_of
from smartplay_tools import InvalidArgumentError, MissingExtraError, Player, Prompt, Reply, ToolSpec, schema


class LangChainPlayer:
    """The player `langchain:MODEL`: any chat model that LangChain knows.

    Arguments:
        model: a name for LangChain's `init_chat_model`, such as "openai:gpt-4o-mini", or a chat model.
        seed: unused; what a model draws is its own affair.
        limit_field: how the model calls the cap on a reply.
        parameters: further arguments of `init_chat_model`, such as `temperature=0`.
    """

    def __init__(
        self, model: str | BaseChatModel = "", *, seed: int = 0, limit_field: str = "max_tokens", **parameters: Any
    ) -> None:
        if not model:
            raise InvalidArgumentError("This player needs a model: langchain:MODEL.")
        self._model = _chat_model(model, parameters) if isinstance(model, str) else model
        self._limit_field = limit_field
        self.name = f"langchain:{model if isinstance(model, str) else type(model).__name__}"

    def reply(self, prompt: Prompt) -> Reply:
        """Ask the model."""
        return _reply(self._bound(prompt).invoke(to_langchain(prompt.messages)))

    async def areply(self, prompt: Prompt) -> Reply:
        """Ask the model without holding up the event loop."""
        return _reply(await self._bound(prompt).ainvoke(to_langchain(prompt.messages)))

    def _bound(self, prompt: Prompt) -> Runnable[LanguageModelInput, AIMessage]:
        limit: dict[str, Any] = {} if prompt.max_tokens is None else {self._limit_field: prompt.max_tokens}
        if not prompt.tools:
            return self._model.bind(**limit)
        return self._model.bind_tools([schema(tool, "openai") for tool in prompt.tools], **limit)


class PlayerChatModel(BaseChatModel):
    """A player of this package as a chat model: agents can be tried, tested and shown without a key."""

    model_config = ConfigDict(arbitrary_types_allowed=True)

    player: Player = Field(exclude=True)

    @property
    def _llm_type(self) -> str:
        return f"smartplay-{self.player.name}"

    def bind_tools(self, tools: Sequence[Any], **kwargs: Any) -> Runnable[LanguageModelInput, AIMessage]:
        """Have the player told of these tools."""
        return self.bind(tools=[convert_to_openai_tool(tool) for tool in tools], **kwargs)

    def _generate(
        self,
        messages: list[BaseMessage],
        stop: list[str] | None = None,
        run_manager: CallbackManagerForLLMRun | None = None,
        *,
        tools: Sequence[dict[str, Any]] = (),
        max_tokens: int | None = None,
        **kwargs: Any,
    ) -> ChatResult:
        functions = [tool["function"] for tool in tools]
        specs = tuple(ToolSpec(f["name"], f.get("description", ""), f.get("parameters", {})) for f in functions)
        reply = self.player.reply(Prompt([from_langchain(message) for message in messages], specs, max_tokens))
        (message,) = to_langchain([reply.message])
        if reply.usage is not None and isinstance(message, AIMessage):
            prompt, said = reply.usage.prompt, reply.usage.reply
            message.usage_metadata = {"input_tokens": prompt, "output_tokens": said, "total_tokens": prompt + said}
        return ChatResult(generations=[ChatGeneration(message=message)])


def _chat_model(name: str, parameters: dict[str, Any]) -> BaseChatModel:
    try:
        from langchain.chat_models import init_chat_model
    except ModuleNotFoundError as error:
        raise MissingExtraError("The player langchain:MODEL", "langchain") from error
    model: BaseChatModel = init_chat_model(name, **parameters)
    return model


def _reply(message: AIMessage) -> Reply:
    return Reply(from_langchain(message), usage_of(message))
