"""OpenAI's two interfaces, chat completions and Responses, as a scripted server."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import smartplay_tools as sp
from smartplay_tools.types.messages import text_of
from tests.adapters.conformance import Received
from tests.adapters.scripted_server import ScriptedServer


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
        messages = self.read(path, body).messages
        ids = [call["id"] for message in messages for call in message.get("tool_calls", ())]
        assert len(ids) == len(set(ids)), "each call has an id of its own"
        waiting: list[str] = []
        for message in messages:
            if message["role"] == "tool":
                waiting.remove(message["tool_call_id"])
            else:
                assert not waiting, "every call has its result before the next message"
            waiting += [call["id"] for call in message.get("tool_calls", ())]
        assert not waiting

    def read(self, path: str, body: dict[str, Any]) -> Received:
        if path == "/v1/chat/completions":
            functions = [tool["function"] for tool in body["tools"]]
            messages, cap = body["messages"], body.get("max_tokens")
        else:
            functions = body["tools"]
            messages, cap = list(read_items(body["input"])), body.get("max_output_tokens")
        tools = [(function["name"], function["description"], function["parameters"]) for function in functions]
        return Received(messages, tools, cap)


def read_items(items: Iterable[Mapping[str, Any]]) -> Iterator[dict[str, Any]]:
    """Read input items as messages; all that a model said between two others is one assistant message."""
    reply: dict[str, Any] | None = None
    for item in items:
        kind = item.get("type", "message")
        if kind == "function_call" or (kind == "message" and item["role"] == "assistant"):
            reply = reply or {"role": "assistant", "content": "", "tool_calls": []}
            if kind == "message":
                reply["content"] += text_of(item)
            else:
                function = {"name": item["name"], "arguments": item["arguments"]}
                reply["tool_calls"].append({"id": item["call_id"], "function": function})
            continue
        if reply is not None:
            yield reply
            reply = None
        if kind == "function_call_output":
            yield {"role": "tool", "tool_call_id": item["call_id"], "content": item["output"]}
        elif kind == "message":
            yield {"role": item["role"], "content": item["content"]}
    if reply is not None:
        yield reply
