"""Compactors of Inspect, with their code unchanged, through the handler that its agents call before the model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from inspect_ai.model import (
    ChatMessage,
    CompactionEdit,
    CompactionStrategy,
    CompactionSummary,
    CompactionTrim,
    GenerateConfig,
    Model,
    ModelAPI,
    ModelOutput,
    compaction,
    modelapi,
)
from inspect_ai.tool import ToolChoice, ToolInfo

from smartplay_inspect.messages import from_inspect, to_inspect
from smartplay_tools import Message
from smartplay_tools.context.compaction import ContextOverflowError
from smartplay_tools.context.strategies.imported import ImportedCompactor
from smartplay_tools.types.messages import calls_of, text_of


class InspectCompactor(ImportedCompactor):
    """What compactors of Inspect have in common: the handler keeps what it has compacted by the ids of messages."""

    packages = ("inspect-ai",)

    def make(self, limit: int) -> Model:
        """Return the model that counts, and that a summary is asked of; the handler needs the first messages."""
        self._handler: Any = None
        self._strategy = self.strategy(limit)
        return Model(AskedModel(self), GenerateConfig())

    def strategy(self, limit: int) -> CompactionStrategy:
        """Return the strategy of Inspect."""
        raise NotImplementedError

    async def rewrite(self, history: Sequence[Message]) -> list[Message]:
        """Call the handler."""
        functions = {call["id"]: call["function"]["name"] for message in history for call in calls_of(message)}
        messages = [to_inspect(message, functions) for message in history]
        for at, message in enumerate(messages):
            message.id = f"m{at}"
        if self._handler is None:
            self._handler = compaction(self._strategy, prefix=messages[:1], model=self.made)
        made, _ = await self._handler.compact_input(messages)
        return [from_inspect(message) for message in made]


@modelapi(name="smartplay-compactor")
class AskedModel(ModelAPI):
    """The model that a compactor asks."""

    def __init__(self, compactor: InspectCompactor) -> None:
        super().__init__(compactor.name)
        self._compactor = compactor

    async def generate(
        self,
        input: list[ChatMessage],  # noqa: A002 - Inspect's name
        tools: list[ToolInfo],
        tool_choice: ToolChoice,
        config: GenerateConfig,
    ) -> ModelOutput:
        """Ask; a question that is too long is answered as Inspect's providers answer it."""
        try:
            text = text_of(self._compactor.ask([from_inspect(message) for message in input]))
        except ContextOverflowError as error:
            return ModelOutput.from_content(self.model_name, str(error), "model_length")
        return ModelOutput.from_content(self.model_name, text)

    async def count_tokens(self, input: str | list[ChatMessage], config: GenerateConfig | None = None) -> int:  # noqa: A002
        """Count as the window counts."""
        if isinstance(input, str):
            return self._compactor.count_text(input)
        return self._compactor.count(map(from_inspect, input))


class Edit(InspectCompactor):
    """`CompactionEdit`: old results are cleared."""

    def strategy(self, limit: int) -> CompactionStrategy:
        """Return the strategy of Inspect."""
        return CompactionEdit(threshold=limit, keep_tool_uses=self.keep)


class Trim(InspectCompactor):
    """`CompactionTrim`: the oldest messages leave. `keep` is the share of the others in percent, 80 by default."""

    def __init__(self, tokens: int | None = None, keep: int = 80) -> None:
        super().__init__(tokens, keep)

    def strategy(self, limit: int) -> CompactionStrategy:
        """Return the strategy of Inspect."""
        return CompactionTrim(threshold=limit, preserve=self.keep / 100)


class Summary(InspectCompactor):
    """`CompactionSummary`: a summary takes the place of all but the task. `keep` means nothing here."""

    def strategy(self, limit: int) -> CompactionStrategy:
        """Return the strategy of Inspect."""
        return CompactionSummary(threshold=limit)
