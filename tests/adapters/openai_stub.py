"""OpenAI's two interfaces, chat completions and Responses, as a scripted server."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import smartplay_tools as sp
from tests.adapters.conformance import Received
from tests.adapters.scripted_server import ScriptedServer
from tests.dialects.refusals import repeated_ids, results
from tests.dialects.said import Turn, read_chat, read_responses


class OpenAIStub(ScriptedServer):
    """Below `base_url` are `/chat/completions` and `/responses`; each answer reports a usage, if there is one."""

    def __init__(self, script: Iterable[Any], usage: sp.Usage | None = None) -> None:
        super().__init__(script)
        self.base_url = f"{self.url}/v1"
        self._usage = usage

    def say(self, path: str, body: dict[str, Any], message: Any) -> dict[str, Any]:
        if path == "/v1/chat/completions":
            choice = {"index": 0, "message": message, "finish_reason": "stop"}
            answer = {"id": "c", "object": "chat.completion", "created": 0, "model": "m", "choices": [choice]}
            return answer | self._spent("prompt", "completion")
        output: list[dict[str, Any]] = []
        if message["content"] or not message.get("tool_calls"):
            words = [{"type": "output_text", "text": message["content"] or "", "annotations": []}]
            output.append({"type": "message", "id": "msg", "role": "assistant", "content": words})
        calls = [{"call_id": call["id"], **call["function"]} for call in message.get("tool_calls", ())]
        output += [{"type": "function_call", "id": "fc", **call} for call in calls]
        answer = {"id": "r", "object": "response", "status": "completed", "model": "m", "output": output}
        return answer | self._spent("input", "output")

    def _spent(self, prompt: str, reply: str) -> dict[str, Any]:
        if (usage := self._usage) is None:
            return {}
        counts = {f"{prompt}_tokens": usage.prompt, f"{reply}_tokens": usage.reply}
        details = {f"{prompt}_tokens_details": {"cached_tokens": usage.cached}}
        return {"usage": {**counts, **details, "total_tokens": usage.prompt + usage.reply}}

    def check(self, path: str, body: dict[str, Any]) -> None:
        turns = (read_chat if path == "/v1/chat/completions" else read_responses)(body)
        assert repeated_ids(turns, body, {}, words="each call has an id of its own") is None
        assert results(turns, body, {}, status=400, missing="{id} has no result", orphaned="{id} has no call") is None

    def read(self, path: str, body: dict[str, Any]) -> Received:
        if path == "/v1/chat/completions":
            functions = [tool["function"] for tool in body.get("tools", ())]
            messages, cap = body["messages"], body.get("max_tokens")
        else:
            functions = body.get("tools", ())
            messages, cap = [*map(message_of, read_responses(body))], body.get("max_output_tokens")
        tools = [(function["name"], function["description"], function["parameters"]) for function in functions]
        return Received(messages, tools, cap)


def message_of(turn: Turn) -> dict[str, Any]:
    """What a format may spread over several items, as one message."""
    if turn.role == "tool":
        return {"role": "tool", "tool_call_id": turn.results[0], "content": turn.words}
    if turn.role != "assistant":
        return {"role": turn.role, "content": turn.words}
    calls = [{"id": i, "function": {"name": name, "arguments": said}} for i, name, said in turn.calls]
    return {"role": "assistant", "content": turn.words, "tool_calls": calls}
