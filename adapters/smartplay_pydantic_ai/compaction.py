"""Compactors of Pydantic AI and of its harness, with their code unchanged, called before a request as an agent does."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pydantic_ai import ModelContextWindowExceededError, RunContext
from pydantic_ai.capabilities import AbstractCapability, ProcessHistory
from pydantic_ai.messages import ModelMessage, ModelResponse
from pydantic_ai.models import ModelRequestContext, ModelRequestParameters
from pydantic_ai.models.function import AgentInfo, FunctionModel
from pydantic_ai.usage import RunUsage

from smartplay_pydantic_ai.messages import PydanticAIChat, from_history, to_response
from smartplay_tools import Message
from smartplay_tools.context.strategies.imported import ImportedCompactor
from smartplay_tools.errors import extra_named


class PydanticAICompactor(ImportedCompactor):
    """What compactors of Pydantic AI have in common."""

    packages = ("pydantic-ai-slim",)

    @staticmethod
    def overflow(text: str) -> Exception:
        """Return what Pydantic AI's models raise for a full context."""
        return ModelContextWindowExceededError(ImportedCompactor.name, text)

    async def rewrite(self, history: Sequence[Message]) -> list[Message]:
        """Have the capability edit a request."""
        model, messages = FunctionModel(self._answer), PydanticAIChat().write(history, clean=lambda message: message)
        context = RunContext(deps=None, model=model, usage=RunUsage(), messages=list(messages))
        parameters = ModelRequestParameters()
        request = ModelRequestContext(
            model=model, messages=messages, model_settings=None, model_request_parameters=parameters
        )
        made = await self.made.before_model_request(context, request)
        return from_history(made.messages)

    async def _answer(self, messages: list[ModelMessage], info: AgentInfo) -> ModelResponse:
        instructions: list[Message] = [{"role": "system", "content": info.instructions}] if info.instructions else []
        return to_response(self.ask([*instructions, *from_history(messages)]))


class Newest(PydanticAICompactor):
    """`ProcessHistory` with a function that keeps the first request and the newest messages: `keep`, 12 by default."""

    persistent = True

    def __init__(self, tokens: int | None = None, keep: int = 12) -> None:
        super().__init__(tokens, keep)

    def make(self, limit: int) -> AbstractCapability[Any]:
        """Return the capability."""
        return ProcessHistory(self._newest)

    def _newest(self, messages: list[ModelMessage]) -> list[ModelMessage]:
        return messages if len(messages) <= self.keep else [messages[0], *messages[-self.keep :]]


class HarnessCompactor(PydanticAICompactor):
    """A capability of the harness, which edits the request alone: `keep` messages stay."""

    packages = ("pydantic-ai-harness", "pydantic-ai-slim")
    capability: str
    """The name of its class."""

    def __init__(self, tokens: int | None = None, keep: int = 12) -> None:
        super().__init__(tokens, keep)

    def make(self, limit: int) -> AbstractCapability[Any]:
        """Return the capability."""
        with extra_named("The harness of Pydantic AI", "compactors"):
            from pydantic_ai_harness import compaction
        kind = getattr(compaction, self.capability)
        made: AbstractCapability[Any] = kind(max_tokens=limit, keep_messages=self.keep, tokenizer=self.count_text)
        return made


class Window(HarnessCompactor):
    """`SlidingWindowCompaction`: the oldest messages leave."""

    capability = "SlidingWindowCompaction"


class Summary(HarnessCompactor):
    """`SummarizingCompaction`: a summary takes the place of old messages; it is asked for anew in every request."""

    capability = "SummarizingCompaction"
