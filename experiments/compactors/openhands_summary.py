"""The summarizing condenser of OpenHands, with its code unchanged. Its SDK needs Python 3.12.

pip install smartplay-tools openhands-sdk
smartplay-tools eval ... --prompt-tokens 1500 --strategy experiments/compactors/openhands_summary.py:Summary
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

os.environ.setdefault("OPENHANDS_SUPPRESS_BANNER", "1")

from litellm import ModelResponse
from openhands.sdk import LLM, Message as SdkMessage, TextContent
from openhands.sdk.context.condenser import LLMSummarizingCondenser
from openhands.sdk.context.view import View
from openhands.sdk.event import ActionEvent, Condensation, CondensationRequest, Event, MessageEvent, ObservationEvent
from openhands.sdk.event.base import LLMConvertibleEvent
from openhands.sdk.llm import LLMResponse, MessageToolCall
from openhands.sdk.llm.exceptions import LLMContextWindowExceedError
from openhands.sdk.llm.utils.metrics import MetricsSnapshot
from openhands.sdk.tool import Observation

from smartplay_tools import Message
from smartplay_tools.compactors.imported import ImportedCompactor
from smartplay_tools.context.compaction import GivenHistory
from smartplay_tools.players.conversion import function_call
from smartplay_tools.types.messages import calls_of, text_of

MORE_THAN_ENOUGH = 10**9
"""The tokens that the model can take in, and the events, so that the limit of tokens alone decides."""


@dataclass(eq=False)
class Summary(ImportedCompactor):
    """`LLMSummarizingCondenser`: a summary takes the place of old events.

    The log of events keeps the conversation. An agent whose prompt does not fit asks for a condensation.
    """

    keep: int = 1
    """The first events, which stay."""
    packages = ("openhands-sdk", "litellm")
    overflow = LLMContextWindowExceedError
    _log: list[Event] = field(default_factory=list, init=False)
    _actions: dict[str, ActionEvent] = field(default_factory=dict, init=False)

    def make(self) -> LLMSummarizingCondenser:
        """Return the condenser, whose model counts, too."""
        model = AskedModel(model=self.name, api_key="none", max_input_tokens=MORE_THAN_ENOUGH, usage_id="none")
        model._compactor = self
        return LLMSummarizingCondenser(
            llm=model, max_tokens=self.limit, max_size=MORE_THAN_ENOUGH, keep_first=self.keep
        )

    def rewrite(self, history: GivenHistory) -> list[Message]:
        """Log what is new, and condense until the condenser is content."""
        self._log += (event for message in self.new_of(history) for event in self._events(message))
        while True:
            view = View.from_events(self._log)
            made = self.made.condense(view, agent_llm=self.made.llm)
            shown = _back(LLMConvertibleEvent.events_to_messages(view.events))
            if isinstance(made, Condensation):
                self._log.append(made)
            elif self.is_full(shown) and not isinstance(self._log[-1], Condensation):
                self._log.append(CondensationRequest())
            else:
                return shown

    def _events(self, message: Message) -> Iterator[Event]:
        words, calls = [TextContent(text=text_of(message))], calls_of(message)
        if message["role"] == "tool":
            action = self._actions[message["tool_call_id"]]
            ids = {"tool_name": action.tool_name, "tool_call_id": action.tool_call_id, "action_id": action.id}
            yield ObservationEvent(**ids, observation=Seen(content=words))
        elif not calls:
            source = "user" if message["role"] == "user" else "agent"
            yield MessageEvent(source=source, llm_message=SdkMessage(role=message["role"], content=words))
        for at, call in enumerate(calls):
            name, arguments = call["function"]["name"], call["function"]["arguments"]
            action = self._actions[call["id"]] = ActionEvent(
                thought=words if words[0].text and not at else [],
                action=None,
                tool_name=name,
                tool_call_id=call["id"],
                tool_call=MessageToolCall(id=call["id"], name=name, arguments=arguments, origin="completion"),
                llm_response_id=calls[0]["id"],
            )
            yield action


class Seen(Observation):
    """A result."""


class AskedModel(LLM):
    """The model that a compactor asks."""

    _compactor: Any = None

    def generate(self, messages: list[SdkMessage], *_: Any, **__: Any) -> LLMResponse:
        """Ask."""
        content = [TextContent(text=text_of(self._compactor.ask(_back(messages))))]
        message = SdkMessage(role="assistant", content=content)
        return LLMResponse(message=message, metrics=MetricsSnapshot(), raw_response=ModelResponse(id="reply"))

    def get_token_count(self, messages: list[SdkMessage], *_: Any, **__: Any) -> int:
        """Count as the window counts."""
        return int(self._compactor.count(_back(messages)))


def _back(messages: Iterable[SdkMessage]) -> list[Message]:
    made: list[Message] = []
    for each in messages:
        text = "".join(part.text for part in each.content if isinstance(part, TextContent))
        calls = [function_call(call.id, call.name, call.arguments) for call in each.tool_calls or ()]
        result = {} if each.tool_call_id is None else {"tool_call_id": each.tool_call_id}
        made.append({"role": each.role, "content": text, **({"tool_calls": calls} if calls else {}), **result})
    return made
