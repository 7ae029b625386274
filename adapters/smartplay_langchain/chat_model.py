"""PlayerChatModel: a player of this package as a LangChain chat model, to try out an agent without an API key."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from langchain_core.callbacks import AsyncCallbackManagerForLLMRun, CallbackManagerForLLMRun
from langchain_core.language_models import BaseChatModel, LanguageModelInput
from langchain_core.messages import AIMessage, BaseMessage
from langchain_core.outputs import ChatGeneration, ChatResult
from langchain_core.runnables import Runnable
from langchain_core.utils.function_calling import convert_to_openai_tool
from pydantic import ConfigDict, Field, model_validator

from smartplay_langchain.asking import spec_of
from smartplay_langchain.messages import from_langchain, to_langchain, usage_metadata_of
from smartplay_tools import AsyncPlayer, InvalidArgumentError, Player, Prompt, Reply
from smartplay_tools.conversation.loop import reply_of
from smartplay_tools.players.conversion import received

NO_STOP = "A player has no texts at which a reply is cut off; leave `stop` out."


class PlayerChatModel(BaseChatModel):
    """A player as a chat model.

    Replies report the player's usage; a stream has one piece, the whole reply. Whether a player calls a tool is its own
    choice, so a `tool_choice` has no effect; where a summary is asked for, `Prompt.purpose` tells the player.
    """

    model_config = ConfigDict(arbitrary_types_allowed=True)

    player: Player | AsyncPlayer = Field(exclude=True)
    max_tokens: int | None = None
    """The cap on a reply that the player is told."""

    @model_validator(mode="before")
    @classmethod
    def _has_no_stop(cls, given: Any) -> Any:
        if isinstance(given, Mapping) and given.get("stop"):
            raise ValueError(NO_STOP)
        return given

    @property
    def model_name(self) -> str:
        """The name of the player."""
        return self.player.name

    @property
    def _llm_type(self) -> str:
        return f"smartplay-{self.player.name}"

    @property
    def _identifying_params(self) -> Mapping[str, Any]:
        return {"model_name": self.model_name}

    def bind_tools(
        self, tools: Sequence[Any], *, tool_choice: str | dict[str, Any] | bool | None = None, **kwargs: Any
    ) -> Runnable[LanguageModelInput, AIMessage]:
        """Return the model with these tools."""
        return self.bind(tools=[convert_to_openai_tool(tool) for tool in tools], tool_choice=tool_choice, **kwargs)

    def _generate(
        self,
        messages: list[BaseMessage],
        stop: list[str] | None = None,
        run_manager: CallbackManagerForLLMRun | None = None,
        **settings: Any,
    ) -> ChatResult:
        if not isinstance(self.player, Player):
            raise InvalidArgumentError(f"{self.player.name} is asynchronous: use `ainvoke` or `astream`.")
        return self._result(self.player.reply(self._prompt(messages, stop, settings)))

    async def _agenerate(
        self,
        messages: list[BaseMessage],
        stop: list[str] | None = None,
        run_manager: AsyncCallbackManagerForLLMRun | None = None,
        **settings: Any,
    ) -> ChatResult:
        return self._result(await reply_of(self.player, self._prompt(messages, stop, settings)))

    def _prompt(self, messages: Sequence[BaseMessage], stop: list[str] | None, settings: Mapping[str, Any]) -> Prompt:
        if stop:
            raise InvalidArgumentError(NO_STOP)
        tools, cap = tuple(map(spec_of, settings.get("tools") or ())), settings.get("max_tokens") or self.max_tokens
        return received([from_langchain(message) for message in messages], tools, cap)

    def _result(self, reply: Reply) -> ChatResult:
        (message,) = to_langchain([reply.message])
        assert isinstance(message, AIMessage)
        message.response_metadata["model_name"] = self.model_name
        if (usage := reply.usage) is not None:
            message.usage_metadata = usage_metadata_of(usage)
            message.response_metadata |= {"finish_reason": "length"} if usage.cut else {}
        return ChatResult(generations=[ChatGeneration(message=message)])
