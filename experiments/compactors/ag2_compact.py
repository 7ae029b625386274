"""The compact strategies of AG2, with their code unchanged.

pip install smartplay-tools ag2
smartplay-tools eval ... --prompt-tokens 1500 --strategy experiments/compactors/ag2_compact.py:Summary
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

from ag2 import events
from ag2.compact import CompactionSummary, SummarizeCompact, TailWindowCompact
from ag2.context import ConversationContext
from ag2.stream import MemoryStream

from smartplay_tools import Message
from smartplay_tools.compactors.imported import ImportedCompactor
from smartplay_tools.context.compaction import GivenHistory
from smartplay_tools.players.conversion import function_call, reply_message
from smartplay_tools.types.messages import calls_of, text_of


@dataclass(eq=False)
class Newest(ImportedCompactor):
    """`TailWindowCompact`: the newest events, when the conversation is full."""

    keep: int = 12
    """How many events stay: a reply, or the results of its calls."""
    packages = ("ag2",)
    _events: list[Any] = field(default_factory=list, init=False)
    _calls: dict[str, events.ToolCallEvent] = field(default_factory=dict, init=False)

    def make(self) -> Any:
        """Return the strategy."""
        return TailWindowCompact(self.keep)

    async def rewrite(self, history: GivenHistory) -> list[Message]:
        """Append what is new to the events, and compact them if they are full."""
        for message in self.new_of(history):
            self._append(message)
        if self.count(_back(self._events)) >= self.limit:
            self._events = await self.made.compact(self._events, ConversationContext(MemoryStream()), None)
        return [*_back(self._events)]

    def _append(self, message: Message) -> None:
        text = text_of(message)
        if message["role"] == "tool":
            result = events.ToolResultEvent.from_call(self._calls[message["tool_call_id"]], text)
            if isinstance(self._events[-1], events.ToolResultsEvent):
                self._events[-1].results.append(result)
            else:
                self._events.append(events.ToolResultsEvent([result]))
        elif message["role"] == "assistant":
            calls = [events.ToolCallEvent(id=call["id"], **call["function"]) for call in calls_of(message)]
            self._calls |= {call.id: call for call in calls}
            said = events.ModelMessage(text) if text else None
            self._events.append(events.ModelResponse(said, tool_calls=events.ToolCallsEvent(calls)))
        else:
            self._events.append(events.ModelRequest([events.TextInput(text)]))


class Summary(Newest):
    """`SummarizeCompact`: a summary takes the place of the others."""

    def make(self) -> Any:
        """Return the strategy; this object is the configuration of its model, and the model."""
        model: Any = self
        return SummarizeCompact(self.keep, model)

    def create(self) -> Any:
        """Return the model."""
        return self

    async def __call__(self, prompt: Iterable[Any], *_: Any, **__: Any) -> events.ModelResponse:
        """Answer as a model of AG2."""
        return events.ModelResponse(events.ModelMessage(text_of(self.ask([*_back(prompt)]))))


def _back(kept: Iterable[Any]) -> Iterator[Message]:
    for event in kept:
        if isinstance(event, CompactionSummary):
            yield {"role": "user", "content": event.summary}
        elif isinstance(event, events.ModelRequest):
            yield {"role": "user", "content": _text(event.parts)}
        elif isinstance(event, events.ModelResponse):
            calls = [function_call(call.id, call.name, call.arguments) for call in event.tool_calls.calls]
            yield reply_message(event.message.content if event.message else "", calls)
        else:
            for each in event.results:
                yield {"role": "tool", "content": _text(each.result.parts), "tool_call_id": each.parent_id}


def _text(parts: Iterable[Any]) -> str:
    return "".join(part.content for part in parts)
