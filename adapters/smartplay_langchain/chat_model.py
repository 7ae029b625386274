"""PlayerChatModel: a player of this package as a LangChain chat model, to try out an agent without an API key."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from langchain_core.callbacks import AsyncCallbackManagerForLLMRun, CallbackManagerForLLMRun
from langchain_core.language_models import BaseChatModel, LanguageModelInput
from langchain_core.messages import AIMessage, BaseMessage
from langchain_core.outputs import ChatGeneration, ChatResult
from langchain_core.runnables import Runnable
from langchain_core.utils.function_calling import convert_to_openai_tool
from pydantic import ConfigDict, Field

from smartplay_langchain.messages import from_langchain, to_langchain, usage_metadata_of
from smartplay_tools import AsyncPlayer, InvalidArgumentError, Message, Player, Prompt, Reply, ToolSpec
from smartplay_tools.conversation.loop import reply_of
from smartplay_tools.players.conversion import received
from smartplay_tools.types.messages import calls_of, text_of


class PlayerChatModel(BaseChatModel):
    """A player as a chat model.

    Replies report the player's usage; a stream has one piece, the whole reply. `tool_choice` restricts the tools that
    the player is shown, except where a summary is asked for, which `Prompt.purpose` tells the player. A player that
    does not call a tool although it must is an `InvalidArgumentError`.
    """

    model_config = ConfigDict(arbitrary_types_allowed=True)

    player: Player | AsyncPlayer = Field(exclude=True)
    max_tokens: int | None = None
    """The cap on a reply that the player is told."""
    stop: list[str] | None = None
    """Texts at which a reply is cut off."""

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
        """Return the model with these tools; `tool_choice` is "auto", "any", "none" or the name of a tool."""
        return self.bind(tools=[convert_to_openai_tool(tool) for tool in tools], tool_choice=tool_choice, **kwargs)

    def _generate(
        self,
        messages: list[BaseMessage],
        stop: list[str] | None = None,
        run_manager: CallbackManagerForLLMRun | None = None,
        **settings: Any,
    ) -> ChatResult:
        return _result(self._answer(messages, stop, settings))

    async def _agenerate(
        self,
        messages: list[BaseMessage],
        stop: list[str] | None = None,
        run_manager: AsyncCallbackManagerForLLMRun | None = None,
        **settings: Any,
    ) -> ChatResult:
        return _result(await self._aanswer(messages, stop, settings))

    def _answer(self, messages: Sequence[BaseMessage], stop: list[str] | None, settings: dict[str, Any]) -> AIMessage:
        if not isinstance(self.player, Player):
            raise InvalidArgumentError(f"{self.player.name} is asynchronous: use `ainvoke` or `astream`.")
        prompt, must_call = self._prompt(messages, settings)
        return self._message(self.player.reply(prompt), prompt, must_call, stop)

    async def _aanswer(
        self, messages: Sequence[BaseMessage], stop: list[str] | None, settings: dict[str, Any]
    ) -> AIMessage:
        prompt, must_call = self._prompt(messages, settings)
        return self._message(await reply_of(self.player, prompt), prompt, must_call, stop)

    def _prompt(self, messages: Sequence[BaseMessage], settings: Mapping[str, Any]) -> tuple[Prompt, bool]:
        """The prompt, with the tools that may be called, and whether one of them must be."""
        functions = [tool["function"] for tool in settings.get("tools") or ()]
        specs = [ToolSpec(f["name"], f.get("description", ""), f.get("parameters", {})) for f in functions]
        choice = settings.get("tool_choice")
        if isinstance(choice, Mapping):  # as OpenAI spells it
            choice = choice.get("function", choice).get("name", choice.get("type"))
        cap = settings.get("max_tokens") or self.max_tokens
        prompt = received([from_langchain(message) for message in messages], tuple(specs), cap)
        if choice == "none":
            specs = specs if prompt.purpose != "play" else []
        elif choice not in (None, False, True, "auto", "any", "required"):
            specs = [spec for spec in specs if spec.name == choice]
            if not specs:
                raise InvalidArgumentError(f"tool_choice names the tool {choice!r}, which is not bound.")
        must_call = choice not in (None, False, "auto", "none")
        return replace(prompt, tools=tuple(specs)), must_call

    def _message(self, reply: Reply, prompt: Prompt, must_call: bool, stop: list[str] | None) -> AIMessage:
        answer, offered = reply.message, {spec.name for spec in prompt.tools}
        if must_call and not any(call["function"]["name"] in offered for call in calls_of(answer)):
            raise InvalidArgumentError(f"The player {self.player.name} called no tool, which tool_choice demands.")
        (message,) = to_langchain([_cut(answer, stop or self.stop)])
        assert isinstance(message, AIMessage)
        message.response_metadata["model_name"] = self.model_name
        if (usage := reply.usage) is not None:
            message.usage_metadata = usage_metadata_of(usage)
            message.response_metadata |= {"finish_reason": "length"} if usage.cut else {}
        return message


def _cut(message: Message, stop: Sequence[str] | None) -> Message:
    """Return the message with its text cut at the first of the texts."""
    text = text_of(message)
    ends = [at for word in stop or () if (at := text.find(word)) >= 0]
    return {**message, "content": text[: min(ends)]} if ends else message


def _result(message: AIMessage) -> ChatResult:
    return ChatResult(generations=[ChatGeneration(message=message)])
