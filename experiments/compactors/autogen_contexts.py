"""The model contexts of AutoGen that count messages or tokens, with their code unchanged.

pip install smartplay-tools autogen-core
smartplay-tools eval ... --prompt-tokens 1500 --strategy experiments/compactors/autogen_contexts.py:Buffered
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

from autogen_core import FunctionCall, models
from autogen_core.model_context import BufferedChatCompletionContext, TokenLimitedChatCompletionContext

from smartplay_tools import Message
from smartplay_tools.compactors.imported import ImportedCompactor
from smartplay_tools.context.compaction import GivenHistory
from smartplay_tools.players.conversion import function_call, reply_message
from smartplay_tools.types.messages import calls_of, text_of


@dataclass(eq=False)
class Buffered(ImportedCompactor):
    """`BufferedChatCompletionContext`: the newest messages."""

    keep: int = 12
    """How many messages."""
    packages = ("autogen-core",)
    _functions: dict[str, str] = field(default_factory=dict, init=False)

    def make(self) -> Any:
        """Return the context."""
        return BufferedChatCompletionContext(buffer_size=self.keep)

    async def rewrite(self, history: GivenHistory) -> list[Message]:
        """Add what is new to the context, and get what it shows."""
        for message in self.new_of(history):
            await self.made.add_message(self._message(message))
        return [*_back(await self.made.get_messages())]

    def _message(self, message: Message) -> models.LLMMessage:
        text = text_of(message)
        if message["role"] == "tool":
            call_id = message["tool_call_id"]
            result = models.FunctionExecutionResult(content=text, name=self._functions[call_id], call_id=call_id)
            return models.FunctionExecutionResultMessage(content=[result])
        if message["role"] == "assistant":
            calls = [FunctionCall(id=call["id"], **call["function"]) for call in calls_of(message)]
            self._functions |= {call.id: call.name for call in calls}
            thought = text if calls and text else None
            return models.AssistantMessage(content=calls or text, source="agent", thought=thought)
        is_user = message["role"] == "user"
        return models.UserMessage(content=text, source="user") if is_user else models.SystemMessage(content=text)


class TokenLimited(Buffered):
    """`TokenLimitedChatCompletionContext`: it takes messages out of the middle until the others fit."""

    def make(self) -> Any:
        """Return the context; this object is the client that counts for it."""
        counter: Any = Client(self)
        return TokenLimitedChatCompletionContext(counter, token_limit=self.limit)


class Client:
    """Counts messages as the window does."""

    def __init__(self, compactor: ImportedCompactor) -> None:
        self.compactor = compactor

    def count_tokens(self, messages: Iterable[models.LLMMessage], **_: Any) -> int:
        """Count."""
        return self.compactor.count(_back(messages))


def _back(messages: Iterable[models.LLMMessage]) -> Iterator[Message]:
    for message in messages:
        if isinstance(message, models.FunctionExecutionResultMessage):
            for result in message.content:
                yield {"role": "tool", "content": result.content, "tool_call_id": result.call_id}
        elif isinstance(message, models.AssistantMessage):
            called = message.content if isinstance(message.content, list) else []
            text = message.thought or "" if isinstance(message.content, list) else message.content
            yield reply_message(text, [function_call(call.id, call.name, call.arguments) for call in called])
        elif isinstance(message, models.SystemMessage):
            yield {"role": "system", "content": message.content}
        else:
            yield {"role": "user", "content": str(message.content)}
