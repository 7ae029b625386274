"""Compactors of Pydantic AI and of its harness, with their code unchanged, called before a request as an agent does."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import Any, ClassVar

from pydantic_ai import ModelContextWindowExceededError, RunContext, models
from pydantic_ai.capabilities import ProcessHistory
from pydantic_ai.messages import ModelMessage, ModelResponse
from pydantic_ai.models.function import AgentInfo, FunctionModel
from pydantic_ai.usage import RunUsage

from smartplay_pydantic_ai.messages import PydanticAIChat, from_history, to_response
from smartplay_tools import Message
from smartplay_tools.compactors.imported import ImportedCompactor
from smartplay_tools.context.compaction import GivenHistory


@dataclass(eq=False)
class PydanticAICompactor(ImportedCompactor):
    """What compactors of Pydantic AI have in common."""

    keep: int = 12
    """The messages that stay: requests and responses."""
    packages: ClassVar[tuple[str, ...]] = ("pydantic-ai-slim",)
    overflow = staticmethod(partial(ModelContextWindowExceededError, ImportedCompactor.name))

    async def rewrite(self, history: GivenHistory) -> list[Message]:
        """Have the capability edit a request."""
        model, messages = FunctionModel(self._answer), PydanticAIChat().write(history, clean=lambda message: message)
        run = RunContext(deps=None, model=model, usage=RunUsage(), messages=[*messages])
        parameters = models.ModelRequestParameters()
        request = models.ModelRequestContext(
            model=model, messages=messages, model_settings=None, model_request_parameters=parameters
        )
        made = await self.made.before_model_request(run, request)
        return from_history(made.messages)

    async def _answer(self, messages: list[ModelMessage], info: AgentInfo) -> ModelResponse:
        instructions: list[Message] = [{"role": "system", "content": info.instructions}] if info.instructions else []
        return to_response(self.ask([*instructions, *from_history(messages)]))


@dataclass(eq=False)
class NewestMessages(PydanticAICompactor):
    """`ProcessHistory` with a function that keeps the first request and the newest messages."""

    tokens: None = field(default=None, init=False)
    persistent = True

    def make(self) -> ProcessHistory[Any]:
        """Return the capability."""
        return ProcessHistory(self._newest)

    def _newest(self, messages: list[ModelMessage]) -> list[ModelMessage]:
        return messages if len(messages) <= self.keep else [messages[0], *messages[-self.keep :]]


class HarnessWindow(PydanticAICompactor):
    """`SlidingWindowCompaction` of the harness: the oldest messages leave the request."""

    packages = ("pydantic-ai-harness", "pydantic-ai-slim")
    capability = "SlidingWindowCompaction"

    def make(self) -> Any:
        """Return the capability."""
        from pydantic_ai_harness import compaction

        kind = getattr(compaction, self.capability)
        return kind(max_tokens=self.limit, keep_messages=self.keep, tokenizer=self.count_tokens)


class HarnessSummary(HarnessWindow):
    """`SummarizingCompaction` of the harness: a summary takes their place, and is asked for anew in every request."""

    capability = "SummarizingCompaction"
