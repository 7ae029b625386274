"""Surfaces: the interfaces whose prompts the endpoints read, fit and count, and how each words a refusal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from smartplay_tools import ContextManager, FittedPrompt, InvalidArgumentError, PromptOverflowError, SmartPlayError
from smartplay_tools.errors import TranscriptError
from smartplay_tools.players.wire import RequestError

Json = dict[str, Any]

STORED = ("previous_response_id", "conversation", "prompt")
"""Fields of a request to Responses that stand for what the provider keeps."""


KINDS = {
    400: "invalid_request_error",
    401: "authentication_error",
    404: "not_found_error",
    413: "request_too_large",
    503: "overloaded_error",
}
"""Anthropic's types of errors by status; any other is an `api_error`."""


@dataclass(frozen=True)
class Surface:
    """An interface whose prompts are fitted."""

    form: Any
    """The name of the form of its messages."""
    messages: str
    """The field with the messages."""
    system: str | None
    """The field with instructions beside them."""

    def conversation(self, body: Mapping[str, Any]) -> list[Any] | None:
        """Return the messages of a request; None if it has none that could be read, which its provider will say."""
        given = body.get(self.messages)
        if isinstance(given, str):
            given = [{"role": "user", "content": given}]
        return given if isinstance(given, list) and isinstance(body.get("tools") or [], list) else None

    def fitted(self, body: Mapping[str, Any], manager: ContextManager) -> FittedPrompt | None:
        """Return the prompt of a request; None if it has no messages that could be read."""
        if (given := self.conversation(body)) is None:
            return None
        for name in STORED if self.form == "responses" else ():
            if body.get(name) is not None:
                raise InvalidArgumentError(
                    f"With `{name}` the provider adds what it keeps, which cannot be counted; leave it out."
                )
        return manager.fit(given, **self._beside(body))

    def count(self, body: Mapping[str, Any], messages: Sequence[Any], manager: ContextManager) -> int:
        """Return the tokens of a request's prompt if these were its messages, of which none is left out."""
        return manager.count(messages, **self._beside(body))

    def _beside(self, body: Mapping[str, Any]) -> Json:
        """What of a request counts beside its messages."""
        system = body.get(self.system) if self.system else None
        beside = {"tools": body.get("tools") or [], "system": system, "output_schema": self._schema(body)}
        return {**beside, "form": self.form}

    def _schema(self, body: Mapping[str, Any]) -> Any:
        """The schema of the answer's format, wherever the interface has it."""
        if self.form == "responses":
            text = body.get("text")
            wanted = text.get("format") if isinstance(text, Mapping) else None
        else:
            wanted = body.get("response_format", body.get("output_format"))
        return wanted.get("json_schema", wanted.get("schema")) if isinstance(wanted, Mapping) else None

    def refused(self, error: SmartPlayError) -> RequestError:
        """Return the refusal of a prompt that cannot be sent, as the provider words it."""
        is_long = isinstance(error, PromptOverflowError)
        if isinstance(error, TranscriptError):  # a disk that is full now may have room when the client tries again
            return RequestError(500, str(error), headers={"x-should-retry": "true"})
        if self.form == "anthropic":
            return RequestError(400, f"prompt is too long: {error}" if is_long else str(error))
        code = "context_length_exceeded" if is_long else "invalid_prompt"
        return RequestError(400, str(error), param=self.messages, code=code)

    def refusal(self, error: RequestError) -> Json:
        """Return the body of a refusal in the provider's form; a code is where its clients look for one."""
        if self.form != "anthropic":
            return error.body()
        details = {"details": {"error_code": error.code}} if error.code else {}
        told = {"type": KINDS.get(error.status, "api_error"), "message": str(error), **details}
        return {"type": "error", "error": told}


CHAT = Surface("chat", "messages", None)
RESPONSES = Surface("responses", "input", "instructions")
COMPACT = Surface("responses", "input", "instructions")
"""That of `/responses/compact`."""
MESSAGES = Surface("anthropic", "messages", "system")

BY_PATH: Mapping[str, Surface] = {
    "/chat/completions": CHAT,
    "/responses": RESPONSES,
    "/responses/compact": COMPACT,
    "/messages": MESSAGES,
}
"""The interfaces by the end of their paths."""


COUNTED: Mapping[str, Surface] = {"/messages/count_tokens": MESSAGES, "/responses/input_tokens": RESPONSES}
"""The interfaces by the ends of paths at which a provider counts a prompt."""


def surface_of(path: str) -> Surface | None:
    """Return the interface that a path belongs to; None for any other path."""
    return next((surface for end, surface in BY_PATH.items() if path.endswith(end)), None)
