"""Players of this package as models of Inspect's: `--model smartplay/rule` is a free, offline baseline.

A sample is played by its own player, made from the episode's seed as `smartplay-tools eval` makes it, so samples
that run at the same time cannot disturb each other's draws.
"""

from __future__ import annotations

from typing import Any

import anyio.to_thread
from inspect_ai.model import (
    ChatCompletionChoice,
    ChatMessage,
    ChatMessageAssistant,
    GenerateConfig,
    ModelAPI,
    ModelOutput,
    ModelUsage,
    StopReason,
    modelapi,
)
from inspect_ai.tool import ToolChoice, ToolInfo
from inspect_ai.util import store_as

from smartplay_inspect.messages import from_inspect, tool_calls, tool_specs
from smartplay_inspect.solver import Played
from smartplay_tools import AsyncPlayer, InvalidArgumentError, Message, Player, Prompt, Reply, Usage, get_player
from smartplay_tools.context.tokens import TokenCounter
from smartplay_tools.conversation import AttachedPlayer
from smartplay_tools.players.conversion import received
from smartplay_tools.types.messages import text_of


@modelapi(name="smartplay")
class PlayerModel(ModelAPI):
    """The model `smartplay/NAME`, where NAME is a player's; `-M KEY=VALUE` is an option of the player.

    Its usage is what the player reports, or else budget tokens, counted here, where a model receives its prompt.
    """

    def __init__(
        self,
        model_name: str,
        base_url: str | None = None,
        api_key: str | None = None,
        config: GenerateConfig = GenerateConfig(),  # noqa: B008 - Inspect's signature
        **options: Any,
    ) -> None:
        super().__init__(model_name, base_url, api_key, [], config)
        self._options = options
        self._players: dict[str, Player | AsyncPlayer] = {}
        """The player of every attempt at a sample."""
        self._counter = TokenCounter()

    async def generate(
        self,
        input: list[ChatMessage],  # noqa: A002 - Inspect's name
        tools: list[ToolInfo],
        tool_choice: ToolChoice,
        config: GenerateConfig,
    ) -> ModelOutput:
        """Let the player answer."""
        messages = list(map(from_inspect, input))
        prompt = received(messages, tool_specs(tools), config.max_tokens)
        reply = await self._reply(self._player(), prompt)
        return self._output(reply.message, self._count(prompt, reply.message).replaced_by(reply.usage))

    def _player(self) -> Player | AsyncPlayer:
        played = store_as(Played)
        if played.attempt not in self._players:
            player = get_player(self.model_name, **{"seed": played.seed, **self._options})
            if isinstance(player, AttachedPlayer):
                raise InvalidArgumentError(
                    f"The player {self.model_name!r} needs the game itself, which an Inspect model does not have."
                )
            self._players[played.attempt] = player
        return self._players[played.attempt]

    async def _reply(self, player: Player | AsyncPlayer, prompt: Prompt) -> Reply:
        if isinstance(player, AsyncPlayer):
            return await player.areply(prompt)
        return await anyio.to_thread.run_sync(player.reply, prompt)

    def _count(self, prompt: Prompt, message: Message) -> Usage:
        return Usage(
            prompt=self._counter.prompt(prompt.messages, prompt.tools), reply=self._counter.message(message), requests=1
        )

    def _output(self, message: Message, usage: Usage) -> ModelOutput:
        calls = tool_calls(message)
        answer = ChatMessageAssistant(
            content=text_of(message), tool_calls=calls or None, source="generate", model=self.model_name
        )
        total = usage.prompt + usage.reply
        ended: StopReason = "max_tokens" if usage.cut else "tool_calls" if calls else "stop"
        return ModelOutput(
            model=self.model_name,
            choices=[ChatCompletionChoice(message=answer, stop_reason=ended)],
            usage=ModelUsage(
                input_tokens=usage.prompt - (usage.cached or 0) - usage.written,
                input_tokens_cache_read=usage.cached,
                input_tokens_cache_write=usage.written,
                output_tokens=usage.reply,
                reasoning_tokens=usage.reasoning,
                total_tokens=total,
            ),
        )
