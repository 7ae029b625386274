"""A server that speaks a dialect: it refuses what the real one refuses, and says a script as the real one says it.

It is reached at its own address, or as a proxy, by clients that ask for the real host.
"""

from __future__ import annotations

import json
import random
import threading
from collections.abc import Callable, Collection, Sequence
from typing import Any

from tests.dialects import speech
from tests.dialects.failures import Failure
from tests.dialects.rules import Dialect, Kind, Rule
from tests.dialects.said import Json, Said, Turn, plainer, read_chat, read_messages, read_responses
from tests.loopback import Loopback

Answers = Callable[[Said, int, str], Json]
Streams = Callable[[Json, random.Random], Sequence[Any]]
INTERFACES: dict[str, tuple[str, Callable[[Json], list[Turn]], Answers, Streams]] = {
    "chat": ("/chat/completions", read_chat, speech.chat, speech.chat_stream),
    "responses": ("/responses", read_responses, speech.responses, speech.responses_stream),
    "messages": ("/messages", read_messages, speech.messages, speech.messages_stream),
}
"""For each interface its path, how requests are read, and how answers and streams are written."""

ERRORS: dict[str, Callable[[int, Any], Any]] = {
    "openai": lambda status, words: {"error": {"message": words, "type": "invalid_request_error", "code": None}},
    "flat": lambda status, words: {"object": "error", "message": words, "type": "BadRequestError", "code": status},
    "llama.cpp": lambda status, words: {"error": {"code": status, "message": words, "type": "server_error"}},
    "text": lambda status, words: {"error": words},
    "minimax": lambda status, words: {"type": "error", "error": {"type": "bad_request_error", "message": words}},
    "gemini": lambda status, words: [{"error": {"code": status, "message": words, "status": "INVALID_ARGUMENT"}}],
    "cerebras": lambda status, words: {"message": words, "type": "invalid_request_error", "code": "wrong_api_format"},
    "message": lambda status, words: {"message": words},
    "xai": lambda status, words: {"code": "Client specified an invalid argument", "error": words},
    "zai": lambda status, words: {"error": {"code": "1214", "message": words}},
    "databricks": lambda status, words: {"error_code": "BAD_REQUEST", "message": json.dumps({"message": words})},
    "anthropic": lambda status, words: {"type": "error", "error": {"type": "invalid_request_error", "message": words}},
}


def rules_of(dialect: Dialect, kind: Kind, without: Collection[str] = ()) -> list[Rule]:
    """The rules of a dialect but for those whose function, or its first word, is in `without`."""
    named = [(rule, rule.act.func.__name__) for rule in dialect.rules(kind)]
    return [rule for rule, name in named if not {name, name.partition("_")[0]} & {*without}]


def whole_answer(dialect: Dialect, said: Said, number: int, without: Collection[str] = ()) -> Json:
    """A reply as a dialect says it whole."""
    said = plainer(said, {*dialect.cannot, *without})
    whole = INTERFACES[dialect.interface][2](said, number, dialect.ids)
    for rule in rules_of(dialect, "says", without):
        rule.act(whole, said, number)
    return whole


def in_pieces(dialect: Dialect, whole: Json, seed: int, without: Collection[str] = ()) -> Sequence[Any]:
    """The same as a stream, cut by a seed."""
    chunks = INTERFACES[dialect.interface][3](whole, random.Random(seed))
    chunks = json.loads(_json(chunks))
    for rule in rules_of(dialect, "streams", without):
        chunks = rule.act(chunks)
    return chunks


def given_with(whole: Json) -> dict[str, Any]:
    """The message, the output items or the blocks of an answer, by the id of each of its calls."""
    if "choices" in whole:
        message = whole["choices"][0]["message"]
        return {call["id"]: message for call in message.get("tool_calls", ())}
    items = whole.get("output") or whole.get("content") or []
    return {item.get("call_id") or item["id"]: items for item in items if item["type"] in ("function_call", "tool_use")}


class DialectServer(Loopback):
    """Says the replies of a script, one for each request that it does not refuse; the last one again and again.

    In place of a reply a script may have an error of the server's.

    `without` are the names of rules' functions that do not apply, and "thoughts" for a model that does not think, or a
    user who has turned that off.
    """

    def __init__(self, dialect: Dialect, script: Sequence[Said | Failure], *, without: Collection[str] = ()) -> None:
        self.dialect, self._script, self._without = dialect, script, without
        self._path, self._read, _, _ = INTERFACES[dialect.interface]
        self.requests: list[Json] = []
        """The bodies that were answered."""
        self.refused: list[tuple[Rule, str]] = []
        """Which rules were broken, and with which words the requests were refused."""
        self.overlooked: list[str] = []
        """What the server did not read of what it was sent."""
        self._given: dict[str, Any] = {}
        self._lock = threading.Lock()
        super().__init__(self.answer)
        self.base_url = dialect.base_url.format(port=self.port)

    def answer(self, path: str, body: Json) -> tuple[int, str, bytes]:
        """The status, the content type and the body of an answer."""
        path = path.partition("?")[0]
        assert path.endswith(self._path), path
        with self._lock:
            turns = self._read(body)
            for rule in rules_of(self.dialect, "refuses", self._without):
                if (refusal := rule.act(turns, body, self._given)) is not None:
                    self.refused.append((rule, str(refusal[1])))
                    return refusal[0], "application/json", _json(ERRORS[self.dialect.error](*refusal))
            overlooks = rules_of(self.dialect, "overlooks", self._without)
            lost = [rule.act(turns, body, self._given) for rule in overlooks]
            self.overlooked += [refusal[1] for refusal in lost if refusal is not None]
            number = len(self.requests)
            self.requests.append(body)
            said = self._script[min(number, len(self._script) - 1)]
            if isinstance(said, Failure):
                return said.answer(self.dialect.interface)
            whole = whole_answer(self.dialect, said, number, self._without)
            self._given |= given_with(whole)
            if not body.get("stream"):
                return 200, "application/json", _json(whole)
            pieces = in_pieces(self.dialect, whole, number, self._without)
            return 200, "text/event-stream", b"".join(map(_event, pieces))


def _json(value: Any) -> bytes:
    return json.dumps(value).encode()


def _event(chunk: Any) -> bytes:
    """A chunk as a server-sent event; text is a comment, or what is no JSON."""
    if isinstance(chunk, str):
        return f"{chunk if chunk.startswith(':') else f'data: {chunk}'}\n\n".encode()
    named = f"event: {chunk['type']}\n".encode() if "type" in chunk else b""
    return named + b"data: " + _json(chunk) + b"\n\n"
