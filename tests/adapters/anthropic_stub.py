"""A local server with Anthropic's Messages interface that says what a script says, and keeps what it was sent."""

from __future__ import annotations

import json
import threading
from collections.abc import Sequence
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Self

from tests.adapters.conformance import Script

USAGE = {"input_tokens": 5, "cache_read_input_tokens": 3, "cache_creation_input_tokens": 2, "output_tokens": 4}


class AnthropicStub:
    """`faults` are the statuses of the first answers; `extra` blocks begin every reply."""

    def __init__(self, script: Script, faults: Sequence[int] = (), extra: Sequence[dict[str, Any]] = ()) -> None:
        self.bodies: list[dict[str, Any]] = []
        self._script, self._faults, self._extra = iter(script), list(faults), list(extra)
        stub = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def do_POST(self) -> None:
                body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
                status, answer = stub._answer(body)
                data = json.dumps(answer).encode()
                self.send_response(status)
                self.send_header("Content-Type", "application/json")
                self.send_header("Content-Length", str(len(data)))
                self.end_headers()
                self.wfile.write(data)

            def log_message(self, *_: Any) -> None: ...

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self._server.server_port}"

    @property
    def sent(self) -> list[list[dict[str, Any]]]:
        """What the model was sent, in canonical form."""
        return [read(body) for body in self.bodies]

    def __enter__(self) -> Self:
        threading.Thread(target=self._server.serve_forever, args=(0.01,), daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.shutdown()
        self._server.server_close()

    def _answer(self, body: dict[str, Any]) -> tuple[int, dict[str, Any]]:
        if self._faults:
            return self._faults.pop(0), {"type": "error", "error": {"type": "overloaded_error", "message": "busy"}}
        check(body)
        self.bodies.append(body)
        message = next(self._script)
        blocks = [*self._extra]
        if message["content"]:
            blocks.append({"type": "text", "text": message["content"]})
        for call in message.get("tool_calls", ()):
            function = call["function"]
            arguments = json.loads(function["arguments"])
            blocks.append({"type": "tool_use", "id": call["id"], "name": function["name"], "input": arguments})
        return 200, {
            "id": "msg_1",
            "type": "message",
            "role": "assistant",
            "model": body["model"],
            "content": blocks,
            "stop_reason": "tool_use",
            "stop_sequence": None,
            "usage": USAGE,
        }


def check(body: dict[str, Any]) -> None:
    """Refuse what the interface refuses."""
    assert body["max_tokens"] >= 1
    ids: list[str] = []
    waiting: set[str] = set()
    for at, message in enumerate(body["messages"]):
        assert message["role"] == ("user", "assistant")[at % 2]
        assert message["content"]
        results = {block["tool_use_id"] for block in message["content"] if block["type"] == "tool_result"}
        assert results == waiting, "all results of a turn stand together in the next message"
        kinds = [block["type"] for block in message["content"]]
        assert kinds == sorted(kinds, key=lambda kind: kind != "tool_result") or message["role"] == "assistant"
        assert all(block["text"].strip() for block in message["content"] if block["type"] == "text")
        called = [block["id"] for block in message["content"] if block["type"] == "tool_use"]
        ids, waiting = ids + called, set(called)
    assert len(ids) == len(set(ids))


def read(body: dict[str, Any]) -> list[dict[str, Any]]:
    messages: list[dict[str, Any]] = [{"role": "system", "content": body["system"]}]
    for message in body["messages"]:
        blocks = message["content"]
        words = "".join(block["text"] for block in blocks if block["type"] == "text")
        if message["role"] == "assistant":
            calls = [block for block in blocks if block["type"] == "tool_use"]
            functions = [(call["id"], call["name"], json.dumps(call["input"], ensure_ascii=False)) for call in calls]
            tool_calls = [{"id": i, "function": {"name": name, "arguments": text}} for i, name, text in functions]
            messages.append({"role": "assistant", "content": words, "tool_calls": tool_calls})
            continue
        messages.extend(
            {"role": "tool", "tool_call_id": block["tool_use_id"], "content": block["content"]}
            for block in blocks
            if block["type"] == "tool_result"
        )
        if words:
            messages.append({"role": "user", "content": words})
    return messages
