"""How servers say an error: with a status, inside an answer with status 200, or in a stream that has begun."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from typing import Literal

from smartplay_tools.players.server_errors import Row
from tests.dialects.said import Json

How = Literal["status", "answer", "stream"]


@dataclass(frozen=True)
class Failure:
    """An error of the table in place of a reply."""

    row: Row
    how: How

    def answer(self, interface: str) -> tuple[int, str, bytes]:
        """The status, the content type and the body of the answer."""
        status, _, says = self.row.says.partition(" ")
        says = re.sub(r"\b\d[\d.]*s\b", "0.02s", says)  # nobody waits in a test
        if self.row.whose == "field":
            says = says.replace("store", "no_field_of_the_request")
        if self.how == "status":
            return int(status), "application/json", says.encode()
        error = _error(json.loads(says)) | {"status_code": int(status)}
        failed = {"id": "resp_0", "object": "response", "status": "failed", "output": []}
        answer = {"responses": failed, "messages": {"type": "error"}}.get(interface, {}) | {"error": error}
        if self.how == "answer":
            return 200, "application/json", json.dumps(answer).encode()
        if interface == "responses":
            events = [{"type": "response.failed", "sequence_number": 0, "response": answer}]
        else:
            choice = {"index": 0, "delta": {"role": "assistant", "content": None}, "finish_reason": None}
            events = [{"id": "c", "object": "chat.completion.chunk", "choices": [choice]}, answer]
        lines = [f"data: {json.dumps(event)}\n\n" for event in events]
        return 200, "text/event-stream", "".join([*lines, "data: [DONE]\n\n"]).encode()


def _error(body: Json | list[Json]) -> Json:
    """The error in a body; some servers have it in a list, beside its words, or nowhere."""
    body = body[0] if isinstance(body, list) else body
    error = body.get("error", body)
    return {**error} if isinstance(error, dict) else {**body, "message": error}
