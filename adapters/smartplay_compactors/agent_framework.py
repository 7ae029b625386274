"""The summarizing compaction of Microsoft's Agent Framework, with its code unchanged."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, cast

import agent_framework as af
from agent_framework.exceptions import ChatClientInvalidRequestException

from smartplay_tools import Message
from smartplay_tools.compactors.imported import ImportedCompactor
from smartplay_tools.context.compaction import GivenHistory
from smartplay_tools.players.conversion import function_call, reply_message
from smartplay_tools.types.messages import calls_of, text_of


@dataclass(eq=False)
class AgentFrameworkSummary(ImportedCompactor):
    """`SummarizationStrategy`: it counts messages, and writes its notes into the list that it is given."""

    tokens: None = field(default=None, init=False)
    keep: int = 12
    """The messages that stay, about."""
    more: int = 8
    """How many more there are when it acts."""
    packages = ("agent-framework-core",)
    overflow = ChatClientInvalidRequestException
    _kept: list[af.Message] = field(default_factory=list, init=False)

    def make(self) -> Any:
        """Return the strategy; this object is its chat client and its tokenizer."""
        client: Any = self
        return af.SummarizationStrategy(client=client, target_count=self.keep, threshold=self.more, tokenizer=client)

    async def rewrite(self, history: GivenHistory) -> list[Message]:
        """Apply the strategy to the messages so far."""
        self._kept += map(_to_framework, self.new_of(history))
        made = await af.apply_compaction(self._kept, strategy=self.made, tokenizer=self)
        return _from_framework(made)

    async def get_response(self, messages: Iterable[af.Message], **_: Any) -> af.ChatResponse[Any]:
        """Answer as a chat client."""
        reply = text_of(self.ask(_from_framework(messages)))
        return af.ChatResponse(messages=[af.Message("assistant", [reply])])


def _to_framework(message: Message) -> af.Message:
    text = text_of(message)
    if message["role"] == "tool":
        return af.Message("tool", [af.Content.from_function_result(message["tool_call_id"], result=text)])
    calls = [af.Content.from_function_call(call["id"], **call["function"]) for call in calls_of(message)]
    return af.Message(message["role"], [*filter(None, [text]), *calls])


def _from_framework(messages: Iterable[af.Message]) -> list[Message]:
    made: list[Message] = []
    for message in messages:
        results = [each for each in message.contents if each.type == "function_result"]
        sent = [each for each in message.contents if each.type == "function_call"]
        calls = [function_call(each.call_id or "", each.name or "", each.arguments) for each in sent]
        made += ({"role": "tool", "content": each.result, "tool_call_id": each.call_id or ""} for each in results)
        if not results:
            made.append(cast(Message, {**reply_message(message.text, calls), "role": message.role}))
    return made
