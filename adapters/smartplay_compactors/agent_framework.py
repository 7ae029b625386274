"""The summarizing compaction of Microsoft's Agent Framework, with its code unchanged."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from smartplay_tools import Message
from smartplay_tools.context.strategies.imported import ImportedCompactor
from smartplay_tools.errors import extra_named
from smartplay_tools.players.conversion import function_call, reply_message
from smartplay_tools.types.messages import calls_of, text_of

with extra_named("agent-framework-summary", "compactors"):
    import agent_framework as af
    from agent_framework._compaction import SummarizationStrategy
    from agent_framework.exceptions import ChatClientInvalidRequestException


class Summary(ImportedCompactor):
    """`SummarizationStrategy`: it counts messages, and writes into the list that it is given.

    Arguments:
        keep: how many messages it leaves, about.
        threshold: how many more there are before it acts.
    """

    packages = ("agent-framework-core",)
    overflow = ChatClientInvalidRequestException
    additional_properties: dict[str, Any]

    def __init__(self, keep: int = 12, threshold: int = 8) -> None:
        super().__init__(None, keep)
        self._threshold = threshold
        self._kept: list[af.Message] = []
        """The conversation, with what the strategy has noted in it."""
        self._seen = 0
        self.additional_properties = {}

    def make(self, limit: int) -> SummarizationStrategy:
        """Return the strategy; this object is its chat client and its tokenizer."""
        client: Any = self
        return SummarizationStrategy(client=client, target_count=self.keep, threshold=self._threshold, tokenizer=client)

    async def rewrite(self, history: Sequence[Message]) -> list[Message]:
        """Apply the strategy to the messages so far."""
        self._kept += map(_to_framework, history[self._seen :])
        self._seen = len(history)
        made = await af.apply_compaction(self._kept, strategy=self.made, tokenizer=self)
        return [message for each in made for message in _from_framework(each)]

    async def get_response(self, messages: Iterable[af.Message], **_: Any) -> af.ChatResponse[Any]:
        """Answer as a chat client."""
        reply = self.ask([message for each in messages for message in _from_framework(each)])
        return af.ChatResponse(messages=[af.Message("assistant", [text_of(reply)])])

    def count_tokens(self, text: str) -> int:
        """Count as a tokenizer."""
        return self.count_text(text)


def _to_framework(message: Message) -> af.Message:
    text = text_of(message)
    if message["role"] == "tool":
        return af.Message("tool", [af.Content.from_function_result(message["tool_call_id"], result=text)])
    calls = [af.Content.from_function_call(call["id"], **call["function"]) for call in calls_of(message)]
    return af.Message(message["role"], [*([text] if text else []), *calls])


def _from_framework(message: af.Message) -> list[Message]:
    results = [content for content in message.contents if content.type == "function_result"]
    if results:
        return [{"role": "tool", "content": each.result or "", "tool_call_id": each.call_id or ""} for each in results]
    if message.role != "assistant":
        return [{"role": message.role, "content": message.text}]
    sent = [content for content in message.contents if content.type == "function_call"]
    return [reply_message(message.text, [function_call(c.call_id or "", c.name or "", c.arguments) for c in sent])]
