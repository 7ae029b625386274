"""The compactors of Haystack's agents, with their code unchanged.

pip install smartplay-tools haystack-ai
smartplay-tools eval ... --prompt-tokens 1500 --strategy experiments/compactors/haystack_compaction.py:Summary
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, cast

from haystack.dataclasses import ChatMessage, ToolCall
from haystack.hooks.compaction.sliding_window import SlidingWindowCompactor
from haystack.hooks.compaction.summarization import SummarizationCompactor
from haystack.hooks.compaction.tool_result_pruning import ToolResultPruningCompactor

from smartplay_tools import Message
from smartplay_tools.compactors.imported import ImportedCompactor
from smartplay_tools.context.compaction import GivenHistory
from smartplay_tools.players.conversion import function_call, reply_message
from smartplay_tools.types.arguments import object_in
from smartplay_tools.types.messages import calls_of, text_of


class Counter:
    """Counts messages as the window does."""

    def __init__(self, compactor: ImportedCompactor) -> None:
        self.compactor = compactor

    def count(self, messages: Iterable[ChatMessage], **_: Any) -> int:
        """Count."""
        return self.compactor.count(_back(messages))


@dataclass(eq=False)
class HaystackCompactor(ImportedCompactor):
    """Shrinks the conversation to a target when it is full. It knows its summaries by marks, so it keeps messages."""

    target: float = 0.5
    """The share of the room that it shrinks the conversation to."""
    packages = ("haystack-ai",)
    _kept: list[ChatMessage] = field(default_factory=list, init=False)
    _calls: dict[str, ToolCall] = field(default_factory=dict, init=False)

    def rewrite(self, history: GivenHistory) -> list[Message]:
        """Compact what is kept of the conversation, if it is full."""
        self._kept += map(self._message, self.new_of(history))
        if self.room.tokens is not None and self.count(_back(self._kept)) >= self.limit:
            made = self.made.compact(self._kept, int(self.target * self.room.tokens), Counter(self))
            self._kept = self._kept if made is None else made
        return [*_back(self._kept)]

    def _message(self, message: Message) -> ChatMessage:
        text = text_of(message)
        if message["role"] == "tool":
            return ChatMessage.from_tool(text, origin=self._calls[message["tool_call_id"]])
        if message["role"] == "assistant":
            calls = [
                ToolCall(call["function"]["name"], object_in(call["function"]["arguments"]) or {}, id=call["id"])
                for call in calls_of(message)
            ]
            self._calls |= {call.id: call for call in calls if call.id}
            return ChatMessage.from_assistant(text or None, tool_calls=calls)
        return ChatMessage.from_user(text) if message["role"] == "user" else ChatMessage.from_system(text)


@dataclass(eq=False)
class Summary(HaystackCompactor):
    """`SummarizationCompactor`: a summary takes the place of the oldest turns."""

    def make(self) -> SummarizationCompactor:
        """Return it; this object is its generator."""
        model: Any = self
        return SummarizationCompactor(model, approximate_summary_tokens=200)

    def run(self, messages: Iterable[ChatMessage], **_: Any) -> dict[str, list[ChatMessage]]:
        """Answer as a generator of Haystack."""
        return {"replies": [ChatMessage.from_assistant(text_of(self.ask([*_back(messages)])))]}


class Window(HaystackCompactor):
    """`SlidingWindowCompactor`: it drops the oldest turns."""

    make = SlidingWindowCompactor


class Pruning(HaystackCompactor):
    """`ToolResultPruningCompactor`: a short text takes the place of old results of more than 5 tokens."""

    def make(self) -> ToolResultPruningCompactor:
        """Return it."""
        return ToolResultPruningCompactor(min_tokens=5)


def _back(messages: Iterable[ChatMessage]) -> Iterator[Message]:
    for message in messages:
        for result in message.tool_call_results:
            yield {"role": "tool", "content": str(result.result), "tool_call_id": result.origin.id or ""}
        if not message.tool_call_results:
            calls = [function_call(call.id or "", call.tool_name, call.arguments) for call in message.tool_calls]
            yield cast(Message, {**reply_message(message.text or "", calls), "role": message.role.value})
