"""The summarizing memory of LlamaIndex, with its code unchanged."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from smartplay_tools import Message
from smartplay_tools.context.strategies.imported import ImportedCompactor
from smartplay_tools.errors import extra_named
from smartplay_tools.types.messages import text_of

with extra_named("llama-index-summary", "compactors"):
    from llama_index.core.llms import ChatMessage, ChatResponse, CustomLLM, LLMMetadata
    from llama_index.core.memory import ChatSummaryMemoryBuffer

KEPT = ("tool_calls", "tool_call_id")
"""The fields of a message that LlamaIndex keeps beside role and text."""


class Summary(ImportedCompactor):
    """`ChatSummaryMemoryBuffer`: a summary takes the place of what is beyond its tokens of text.

    Its memory keeps the conversation. LlamaIndex has no error for a full context, so the question's own is raised.
    """

    packages = ("llama-index-core",)

    def __init__(self, tokens: int | None = None) -> None:
        super().__init__(tokens)
        self._seen = 0

    def make(self, limit: int) -> ChatSummaryMemoryBuffer:
        """Return the memory."""

        def tokenizer(text: str) -> list[int]:
            return [0] * self.count_text(text)

        return ChatSummaryMemoryBuffer.from_defaults(
            llm=AskedModel(compactor=self), tokenizer_fn=tokenizer, token_limit=limit
        )

    def rewrite(self, history: Sequence[Message]) -> list[Message]:
        """Put what is new into the memory, and get what it shows."""
        for message in history[self._seen :]:
            kept = {name: message[name] for name in KEPT if name in message}
            self.made.put(ChatMessage(role=message["role"], content=text_of(message), additional_kwargs=kept))
        self._seen = len(history)
        return [_from_llama_index(message) for message in self.made.get()]


class AskedModel(CustomLLM):
    """The model that a compactor asks."""

    compactor: Any

    @property
    def metadata(self) -> LLMMetadata:
        """Say nothing about the model."""
        return LLMMetadata()

    def chat(self, messages: Sequence[ChatMessage], **_: Any) -> ChatResponse:
        """Ask."""
        reply = self.compactor.ask([_from_llama_index(message) for message in messages])
        return ChatResponse(message=ChatMessage(role="assistant", content=text_of(reply)))

    def complete(self, *_: Any, **__: Any) -> Any:
        """Nothing that is imported completes a text."""
        raise NotImplementedError

    stream_complete = complete


def _from_llama_index(message: ChatMessage) -> Message:
    kept = {name: message.additional_kwargs[name] for name in KEPT if name in message.additional_kwargs}
    return {"role": message.role.value, "content": message.content or "", **kept}
