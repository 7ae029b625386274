"""The summarizing memory of LlamaIndex, with its code unchanged."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any, cast

from llama_index.core import llms
from llama_index.core.memory import ChatSummaryMemoryBuffer

from smartplay_tools import Message
from smartplay_tools.compactors.imported import ImportedCompactor
from smartplay_tools.context.compaction import GivenHistory
from smartplay_tools.types.messages import text_of

KEPT = ("tool_calls", "tool_call_id")
"""The fields of a message that LlamaIndex keeps beside role and text."""


class LlamaIndexSummary(ImportedCompactor):
    """`ChatSummaryMemoryBuffer`: a summary takes the place of what is beyond its tokens, of text without calls.

    Its memory keeps the conversation. LlamaIndex has no error for a full context; that of the question leaves it.
    """

    packages = ("llama-index-core",)

    def make(self) -> ChatSummaryMemoryBuffer:
        """Return the memory; it takes the length of what its tokenizer returns."""
        model = LlamaIndexModel(max_tokens=None)
        model.compactor = self
        return ChatSummaryMemoryBuffer.from_defaults(
            llm=model, tokenizer_fn=cache(lambda text: [0] * self.count_tokens(text)), token_limit=self.limit
        )

    def rewrite(self, history: GivenHistory) -> list[Message]:
        """Put what is new into the memory, and get what it shows."""
        for message in self.new_of(history):
            kept = {name: value for name, value in message.items() if name in KEPT}
            self.made.put(llms.ChatMessage(role=message["role"], content=text_of(message), additional_kwargs=kept))
        return [_from_llama_index(message) for message in self.made.get()]


class LlamaIndexModel(llms.MockLLM):
    """The model that a compactor asks: LlamaIndex's own without a provider, with other replies."""

    compactor: Any = None

    def chat(self, messages: Sequence[llms.ChatMessage], **_: Any) -> llms.ChatResponse:
        """Ask."""
        reply = self.compactor.ask([_from_llama_index(message) for message in messages])
        return llms.ChatResponse(message=llms.ChatMessage(role="assistant", content=text_of(reply)))


def _from_llama_index(message: llms.ChatMessage) -> Message:
    kept = {name: message.additional_kwargs[name] for name in KEPT if name in message.additional_kwargs}
    return cast(Message, {"role": message.role.value, "content": message.content or "", **kept})
