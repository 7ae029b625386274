"""The event compaction of Google's Agent Development Kit, with its code unchanged.

pip install smartplay-tools google-adk
smartplay-tools eval ... --prompt-tokens 1500 --strategy experiments/compactors/adk_summary.py:Summary
"""

from __future__ import annotations

from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from typing import Any

from google.adk.agents import LlmAgent
from google.adk.apps._configs import EventsCompactionConfig
from google.adk.apps.compaction import _run_compaction_for_token_threshold_config
from google.adk.events.event import Event
from google.adk.flows.llm_flows.context._contents import _get_contents
from google.adk.models import BaseLlm, LlmRequest, LlmResponse
from google.adk.sessions import InMemorySessionService
from google.genai import errors, types

from smartplay_tools import Message
from smartplay_tools.compactors.imported import ImportedCompactor
from smartplay_tools.context.compaction import GivenHistory
from smartplay_tools.players.conversion import function_call, reply_message
from smartplay_tools.types.arguments import object_in
from smartplay_tools.types.messages import calls_of, text_of

NAME = "agent"


@dataclass(eq=False)
class Summary(ImportedCompactor):
    """Compaction at a threshold of tokens: a summary takes the place of old events.

    It reads the tokens of the latest prompt from the events, and goes on without a summary if there was an error.
    """

    keep: int = 6
    """The events that stay."""
    packages = ("google-adk", "google-genai")
    _functions: dict[str, str] = field(default_factory=dict, init=False)
    _events = 0
    _shown = 0

    @staticmethod
    def overflow(text: str) -> Exception:
        """Return what Google's models raise for a full context."""
        return errors.ClientError(400, {"error": {"message": text, "status": "INVALID_ARGUMENT"}})

    def make(self) -> dict[str, Any]:
        """Return the arguments of the compaction."""
        service, agent = (
            InMemorySessionService(),
            LlmAgent(name=NAME, model=AskedModel(model=self.name, compactor=self)),
        )
        session = service.create_session_sync(app_name=NAME, user_id="user", session_id="session")
        config = EventsCompactionConfig(token_threshold=self.limit, event_retention_size=self.keep)
        return {"config": config, "session": session, "session_service": service, "agent": agent}

    async def rewrite(self, history: GivenHistory) -> list[Message]:
        """Append what is new to the session, compact it, and get what a request would contain."""
        session = self.made["session"]
        for message in self.new_of(history):
            await self.made["session_service"].append_event(session, self._event(message))
        await _run_compaction_for_token_threshold_config(**self.made, agent_name=NAME)
        made = [message for content in _get_contents(None, session.events, NAME) for message in _back(content)]
        self._shown = self.count(made)
        return made

    def _event(self, message: Message) -> Event:
        self._events += 1
        is_reply = message["role"] == "assistant"
        usage = types.GenerateContentResponseUsageMetadata(prompt_token_count=self._shown) if is_reply else None
        return Event(
            author="user" if message["role"] == "user" else NAME,
            content=types.Content(role="model" if is_reply else "user", parts=self._parts(message)),
            invocation_id="invocation",
            timestamp=float(self._events),
            usage_metadata=usage,
        )

    def _parts(self, message: Message) -> list[types.Part]:
        text = text_of(message)
        if message["role"] == "tool":
            call_id = message["tool_call_id"]
            result = types.FunctionResponse(id=call_id, name=self._functions[call_id], response={"result": text})
            return [types.Part(function_response=result)]
        parts = [types.Part(text=text)] if text else []
        for call in calls_of(message):
            name, arguments = call["function"]["name"], object_in(call["function"]["arguments"])
            self._functions[call["id"]] = name
            parts.append(types.Part(function_call=types.FunctionCall(id=call["id"], name=name, args=arguments)))
        return parts


class AskedModel(BaseLlm):
    """The model that a compactor asks."""

    compactor: Any

    async def generate_content_async(self, llm_request: LlmRequest, stream: bool = False) -> AsyncIterator[LlmResponse]:
        """Ask."""
        reply = self.compactor.ask([message for content in llm_request.contents for message in _back(content)])
        yield LlmResponse(content=types.Content(role="model", parts=[types.Part(text=text_of(reply))]))


def _back(content: types.Content) -> list[Message]:
    """Return the messages of a content: the results in it, then its text and calls."""
    parts = content.parts or []
    made: list[Message] = [
        {"role": "tool", "content": result.response["result"], "tool_call_id": result.id or ""}
        for part in parts
        if (result := part.function_response) is not None and result.response is not None
    ]
    text = "".join(part.text or "" for part in parts)
    calls = [function_call(c.id or "", c.name or "", c.args) for part in parts if (c := part.function_call) is not None]
    if text or calls:
        made.append(reply_message(text, calls) if content.role == "model" else {"role": "user", "content": text})
    return made
