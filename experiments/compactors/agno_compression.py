"""The compression of tool results in Agno, with its code unchanged.

pip install smartplay-tools agno
smartplay-tools eval ... --prompt-tokens 1500 --strategy experiments/compactors/agno_compression.py:Compression
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, cast

from agno.compression.manager import CompressionManager
from agno.models import message as agno
from agno.models.base import Model
from agno.models.response import ModelResponse

from smartplay_tools import Message
from smartplay_tools.compactors.imported import ImportedCompactor
from smartplay_tools.context.compaction import GivenHistory
from smartplay_tools.players.conversion import reply_message
from smartplay_tools.types.messages import calls_of, text_of


@dataclass(eq=False)
class Compression(ImportedCompactor):
    """`CompressionManager`: when the conversation is full, a summary of each result takes its place."""

    packages = ("agno",)
    _kept: list[agno.Message] = field(default_factory=list, init=False)

    def make(self) -> CompressionManager:
        """Return the manager."""
        return CompressionManager(AskedModel("asked"), True, compress_token_limit=self.limit)

    def rewrite(self, history: GivenHistory) -> list[Message]:
        """Compress what is kept of the conversation."""
        self._kept += map(_to_agno, self.new_of(history))
        self.made.model.compactor = self
        if self.made.should_compress(self._kept, model=self.made.model):
            self.made.compress(self._kept)
        return [*_back(self._kept)]


class AskedModel(Model):
    """The model that a compactor asks, and whose tokens it counts."""

    compactor: Any = None

    def response(self, messages: list[agno.Message], **_: Any) -> ModelResponse:  # type: ignore[override]
        """Ask."""
        return ModelResponse(content=text_of(self.compactor.ask([*_back(messages)])))

    def count_tokens(self, messages: list[agno.Message], *_: Any, **__: Any) -> int:
        """Count messages as the window does."""
        count: int = self.compactor.count(_back(messages))
        return count

    invoke = ainvoke = invoke_stream = ainvoke_stream = Model.response  # type: ignore[assignment]
    _parse_provider_response = _parse_provider_response_delta = Model.response  # type: ignore[assignment]


def _to_agno(message: Message) -> agno.Message:
    calls: Any = calls_of(message) or None
    call_id = message.get("tool_call_id")
    return agno.Message(role=message["role"], content=text_of(message), tool_calls=calls, tool_call_id=call_id)


def _back(messages: Iterable[agno.Message]) -> Iterator[Message]:
    for message in messages:
        text = str(message.get_content(use_compressed_content=True) or "")
        calls: Any = message.tool_calls or []
        if message.role == "tool":
            yield {"role": "tool", "content": text, "tool_call_id": message.tool_call_id or ""}
        else:
            yield cast(Message, {**reply_message(text, calls), "role": message.role})
