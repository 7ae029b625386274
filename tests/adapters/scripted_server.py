"""A local server that replies with a script in a provider's format, and stores what it was sent.

The provider's real client talks to it, so tests check what was really sent.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Iterable, Sequence
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Self

from tests.adapters.conformance import Received


class ScriptedServer:
    """`faults` are the statuses of the first answers. A subclass defines the provider's format."""

    def __init__(self, script: Iterable[Any], faults: Sequence[int] = ()) -> None:
        self.requests: list[tuple[str, dict[str, Any]]] = []
        """Paths and bodies of all requests that were answered."""
        self._script, self._faults = iter(script), list(faults)
        self._listening = ThreadingHTTPServer(("127.0.0.1", 0), self._handler())
        self.url = f"http://127.0.0.1:{self._listening.server_port}"

    @property
    def bodies(self) -> list[dict[str, Any]]:
        return [body for _, body in self.requests]

    @property
    def received(self) -> list[Received]:
        """What the model was sent, in canonical form."""
        return [self.read(path, body) for path, body in self.requests]

    def check(self, path: str, body: dict[str, Any]) -> None:
        """Check a request as the provider does."""

    def say(self, path: str, body: dict[str, Any], message: Any) -> dict[str, Any]:
        """A message of the script as the provider's answer."""
        raise NotImplementedError

    def encoded(self, answered: dict[str, Any]) -> bytes:
        """The body of an answer."""
        return json.dumps(answered).encode()

    def read(self, path: str, body: dict[str, Any]) -> Received:
        """A request in canonical form."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        threading.Thread(target=self._listening.serve_forever, args=(0.01,), daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._listening.shutdown()
        self._listening.server_close()

    def _answer(self, path: str, body: dict[str, Any]) -> tuple[int, dict[str, Any]]:
        if self._faults:
            return self._faults.pop(0), {"type": "error", "error": {"type": "overloaded_error", "message": "busy"}}
        self.check(path, body)
        self.requests.append((path, body))
        return 200, self.say(path, body, next(self._script))

    def _handler(self) -> type[BaseHTTPRequestHandler]:
        answer, encoded = self._answer, self.encoded

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def do_POST(self) -> None:
                body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
                status, answered = answer(self.path, body)
                data = encoded(answered)
                self.send_response(status)
                self.send_header("Content-Type", "application/json")
                self.send_header("Content-Length", str(len(data)))
                self.end_headers()
                self.wfile.write(data)

            def log_message(self, *_: Any) -> None: ...

        return Handler
