"""Compactors of Inspect, with their code unchanged, through the handler that its agents call before the model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from inspect_ai import model

from smartplay_inspect.messages import from_inspect, to_inspect
from smartplay_tools import Message
from smartplay_tools.compactors.imported import ImportedCompactor
from smartplay_tools.context.compaction import ContextOverflowError, GivenHistory
from smartplay_tools.types.messages import calls_of, text_of


class InspectCompactor(ImportedCompactor):
    """What compactors of Inspect have in common: the handler keeps what it has compacted by the ids of messages."""

    packages = ("inspect-ai",)
    _handler: Any = None

    async def rewrite(self, history: GivenHistory) -> list[Message]:
        """Call the handler, which is made of Inspect's strategy, the first message and a model that counts."""
        functions = {call["id"]: call["function"]["name"] for message in history for call in calls_of(message)}
        messages = [to_inspect(message, functions) for message in history]
        for at, message in enumerate(messages):
            message.id = f"m{at}"
        if self._handler is None:
            asked = model.Model(InspectModel(self), model.GenerateConfig())
            self._handler = model.compaction(self.made, prefix=messages[:1], model=asked)
        made, _ = await self._handler.compact_input(messages)
        return [from_inspect(message) for message in made]


@model.modelapi(name="smartplay-compactor")
class InspectModel(model.ModelAPI):
    """The model that a compactor asks."""

    def __init__(self, compactor: InspectCompactor) -> None:
        super().__init__(compactor.name)
        self._compactor = compactor

    async def generate(self, input: list[model.ChatMessage], tools: Any, tool_choice: Any, config: Any) -> Any:  # noqa: A002
        """Ask; a question that is too long is answered as Inspect's providers answer it."""
        try:
            text = text_of(self._compactor.ask([from_inspect(message) for message in input]))
        except ContextOverflowError as error:
            return model.ModelOutput.from_content(self.model_name, str(error), "model_length")
        return model.ModelOutput.from_content(self.model_name, text)

    async def count_tokens(self, input: str | list[model.ChatMessage], *_: Any) -> int:  # noqa: A002
        """Count as the window counts."""
        if isinstance(input, str):
            return self._compactor.count_tokens(input)
        return self._compactor.count(map(from_inspect, input))


@dataclass(eq=False)
class InspectEdit(InspectCompactor):
    """`CompactionEdit`: old results are cleared."""

    keep: int = 6
    """The calls that stay with their results."""

    def make(self) -> model.CompactionStrategy:
        """Return Inspect's strategy."""
        return model.CompactionEdit(threshold=self.limit, keep_tool_uses=self.keep)


class InspectTrim(InspectCompactor):
    """`CompactionTrim`: the oldest messages leave."""

    def make(self) -> model.CompactionStrategy:
        """Return Inspect's strategy."""
        return model.CompactionTrim(threshold=self.limit)


class InspectSummary(InspectCompactor):
    """`CompactionSummary`: a summary takes the place of all but the task."""

    def make(self) -> model.CompactionStrategy:
        """Return Inspect's strategy."""
        return model.CompactionSummary(threshold=self.limit)
