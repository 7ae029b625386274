"""Servers on loopback with OpenAI's interface, which fail as real ones do."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from tests.loopback import Loopback

Answer = tuple[int, dict[str, Any]]


def completion(message: dict[str, Any], **usage: int) -> Answer:
    """A reply in the format of OpenAI's interface."""
    facts: dict[str, Any] = {"id": "c", "object": "chat.completion", "created": 0, "model": "m"}
    facts["choices"] = [{"index": 0, "finish_reason": "stop", "message": {"role": "assistant", **message}}]
    if usage:
        facts["usage"] = {**usage, "total_tokens": sum(usage.values())}
    return 200, facts


def calling(*names: str, ids: bool = True, **arguments: str) -> dict[str, Any]:
    """A message that calls these tools."""
    calls = [
        {
            "id": f"call_{at}" if ids else "",
            "type": "function",
            "function": {"name": name, "arguments": json.dumps(arguments)},
        }
        for at, name in enumerate(names)
    ]
    return {"content": None, "tool_calls": calls}


def refusal(status: int, code: str, text: str) -> Answer:
    return status, {"error": {"message": text, "type": "invalid_request_error", "code": code}}


@contextmanager
def serving(answer: Callable[[dict[str, Any], int], Answer]) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Serve: `answer` gets a request's body and how many there were before. Yields the base URL and all bodies."""
    bodies: list[dict[str, Any]] = []
    lock = threading.Lock()

    def numbered(path: str, body: dict[str, Any]) -> tuple[int, str, bytes]:
        with lock:
            number = len(bodies)
            bodies.append(body)
        status, value = answer(body, number)
        return status, "application/json", json.dumps(value).encode()

    with Loopback(numbered) as server:
        yield f"{server.url}/v1", bodies
