"""A local server that replies with a script in a provider's format, and stores what it was sent.

The provider's real client talks to it, so tests check what was really sent.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from typing import Any

from tests.adapters.conformance import Received
from tests.loopback import Loopback


class ScriptedServer(Loopback):
    """`faults` are the statuses of the first answers. A subclass defines the provider's format."""

    is_strict = True
    """Whether requests are checked. Frameworks spell more ways of saying the same than the players do."""

    def __init__(self, script: Iterable[Any], faults: Sequence[int] = ()) -> None:
        self.requests: list[tuple[str, dict[str, Any]]] = []
        """Paths and bodies of all requests that were answered."""
        self._script, self._faults = iter(script), list(faults)
        super().__init__(self._encoded_answer)

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

    def _encoded_answer(self, path: str, body: dict[str, Any]) -> tuple[int, str, bytes]:
        status, answered = self._answer(path, body)
        return status, "application/json", self.encoded(answered)

    def _answer(self, path: str, body: dict[str, Any]) -> tuple[int, dict[str, Any]]:
        if self._faults:
            return self._faults.pop(0), {"type": "error", "error": {"type": "overloaded_error", "message": "busy"}}
        if self.is_strict:
            self.check(path, body)
        self.requests.append((path, body))
        return 200, self.say(path, body, next(self._script))
