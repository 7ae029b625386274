"""The Agents SDK's own scripted model: a script as its steps, and what it was sent in canonical form."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from agents.testing import ScriptedModel, assistant_message, function_call
from agents.usage import Usage
from openai.types.responses.response_usage import InputTokensDetails

import smartplay_tools as sp
from tests.adapters.conformance import Received
from tests.adapters.openai_stub import message_of
from tests.dialects.said import read_responses


class ReadingModel(ScriptedModel):
    """Replies with its script, step by step."""

    def __init__(self, script: Iterable[sp.Message], usage: sp.Usage | None = None) -> None:
        super().__init__(default_usage=None if usage is None else as_agents_usage(usage))
        self._script = iter(script)

    async def get_response(self, *arguments: Any, **options: Any) -> Any:
        self.enqueue(step(next(self._script)))
        return await super().get_response(*arguments, **options)

    @property
    def received(self) -> list[Received]:
        return [
            Received(
                read(call.input),
                [(tool.name, tool.description, tool.params_json_schema) for tool in call.tools],
                call.model_settings.max_tokens,
            )
            for call in self.calls
        ]


def as_agents_usage(usage: sp.Usage) -> Usage:
    counts = {"input_tokens": usage.prompt, "output_tokens": usage.reply, "total_tokens": usage.prompt + usage.reply}
    cached = InputTokensDetails(cached_tokens=usage.cached or 0, cache_write_tokens=0)
    return Usage(requests=1, input_tokens_details=cached, **counts)


def step(message: sp.Message) -> list[Any]:
    words = [assistant_message(message["content"])] if message["content"] else []
    functions = [(call["id"], call["function"]) for call in message.get("tool_calls", ())]
    return words + [function_call(f["name"], f["arguments"], call_id=call_id) for call_id, f in functions]


def read(items: Any) -> list[dict[str, Any]]:
    return [message_of(turn) for turn in read_responses({"input": items})]
