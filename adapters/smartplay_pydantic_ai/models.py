"""Players of this package as models of Pydantic AI's, with which an agent can be tried without a key."""

from __future__ import annotations

from pydantic_ai.messages import ModelMessage, ModelResponse
from pydantic_ai.models.function import AgentInfo, FunctionModel
from pydantic_ai.usage import RequestUsage

from smartplay_pydantic_ai.messages import from_history, to_response, tool_spec
from smartplay_tools import AsyncPlayer, Player
from smartplay_tools.context.prompts import received
from smartplay_tools.conversation.event_loop import reply_of


class PlayerModel(FunctionModel):
    """A player as a model. One player serves one run at a time: some draw from a generator of their own."""

    def __init__(self, player: Player | AsyncPlayer) -> None:
        self._player = player
        super().__init__(self._answer, model_name=player.name)

    async def _answer(self, messages: list[ModelMessage], info: AgentInfo) -> ModelResponse:
        history, cap = from_history(messages), (info.model_settings or {}).get("max_tokens")
        tools = tuple(map(tool_spec, info.function_tools))
        reply = await reply_of(self._player, received(history, tools, cap))
        response = to_response(reply.message)
        if (usage := reply.usage) is not None:
            response.usage = RequestUsage(
                input_tokens=usage.prompt,
                output_tokens=usage.reply,
                cache_read_tokens=usage.cached,
                cache_write_tokens=usage.written,
                details={"reasoning_tokens": usage.reasoning},
            )
            response.finish_reason = "length" if usage.cut else None
        return response
