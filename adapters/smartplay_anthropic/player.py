"""The player `anthropic:MODEL`.

The environment's proxies are not used for a server on this machine. The client's own retries are switched off, because
`ModelPlayer` retries and counts attempts.
"""

from __future__ import annotations

import importlib
import json
import os
from collections.abc import Mapping
from typing import Any

from smartplay_tools.errors import extra_named

with extra_named("smartplay_anthropic", "anthropic"):
    import anthropic

from smartplay_anthropic import codec
from smartplay_tools import InvalidArgumentError, Prompt, Reply
from smartplay_tools.players import (
    BrokenAnswerError,
    ModelPlayer,
    OptionalFields,
    asks_management,
    check_key,
    check_url,
    readable_proxies,
)
from smartplay_tools.players.cache_marks import CacheMarks, checked_marks

_transport = importlib.import_module(anthropic.DefaultHttpxClient.__mro__[1].__module__)
"""The HTTP library of the client, whose default client uses the environment's proxies whatever it is told."""

LONGEST_CONNECT = 10.0
"""Seconds that a server may take to accept a connection, however long its answers may take."""


class AnthropicPlayer(ModelPlayer):
    """A player that asks a model behind Anthropic's interface.

    Arguments:
        model: the model's name.
        base_url: the server; by default the environment's `ANTHROPIC_BASE_URL`, then Anthropic's own.
        api_key: the key; by default the one that the client finds in the environment or the user's profile. A server on
            this machine needs none.
        limit: the cap on a reply if the budget has none.
        cache: mark the prompt's end, and that of the part that is unchanged since the previous prompt, so that the
            provider caches them; "stable" marks only the latter, which is cheaper if the window slides at every step
            (no `Budget.slack`), and False marks nothing.
        timeout: seconds that an attempt may take without a byte from the server.
        parameters: further arguments of every request, such as `{"temperature": 0}`; a cap on the reply among them
            applies where it is smaller than the budget's.
        options: those of `ModelPlayer`: `seed`, `retries`, `pause`, `at_once`.
    """

    optional: OptionalFields
    observations = ("text", "picture", "both")
    failures = (anthropic.APIError, BrokenAnswerError, json.JSONDecodeError, UnicodeDecodeError)

    def __init__(
        self,
        model: str = "",
        *,
        base_url: str | None = None,
        api_key: str | None = None,
        limit: int = codec.LIMIT,
        cache: CacheMarks = True,
        timeout: float = 300.0,
        parameters: Mapping[str, Any] | None = None,
        **options: Any,
    ) -> None:
        if not model:
            raise InvalidArgumentError("This player needs a model: anthropic:MODEL.")
        super().__init__(f"anthropic:{model}", **options)
        server = base_url or os.environ.get("ANTHROPIC_BASE_URL") or ""
        if server:
            check_url(server, "--base-url" if base_url else "ANTHROPIC_BASE_URL")
        self._http = self.http_options(server)
        if self.is_local(server) and not (
            os.environ.get("ANTHROPIC_API_KEY") or os.environ.get("ANTHROPIC_AUTH_TOKEN")
        ):
            api_key = api_key or "none"
        self._settings: dict[str, Any] = {
            "base_url": base_url,
            "api_key": api_key,  # None: the client looks for a key, a token or a profile itself
            "max_retries": 0,
            "timeout": anthropic.Timeout(timeout, connect=min(timeout, LONGEST_CONNECT)),
        }
        self._check_key()
        self.optional, self.manages_context = OptionalFields(self.name, parameters or {}), asks_management(parameters)
        self._limit, self._cache = limit, checked_marks(cache)
        self._always = {"model": model, **(parameters or {})}

    def _check_key(self) -> None:
        """Raise an error now if there is no key; the client itself does so only at its first use."""
        try:
            with self.new_client() as client:
                has_key = any(getattr(client, place, None) for place in ("api_key", "auth_token", "credentials"))
                for key in (client.api_key, client.auth_token):
                    check_key(key, self.name)
        except anthropic.AnthropicError as error:
            raise InvalidArgumentError(f"The anthropic client finds no key: {error}") from error
        if not has_key:
            raise InvalidArgumentError("A model at Anthropic needs a key: set ANTHROPIC_API_KEY.")

    def request(self, prompt: Prompt) -> dict[str, Any]:
        """Return the arguments of the request for a prompt."""
        return self.optional.fit(codec.request(prompt, limit=self._limit, cache=self._cache, own=self._always))

    def new_client(self) -> anthropic.Anthropic:
        """Return a synchronous client."""
        with readable_proxies():
            http_client = _transport.Client(**self._http) if self._http else anthropic.DefaultHttpxClient()
        return anthropic.Anthropic(**self._settings, http_client=http_client)

    def check_ready(self) -> None:
        """Raise an `InvalidArgumentError` if there is no key; the client would raise only with the first request."""
        super().check_ready()
        self._check_key()

    def new_async_client(self) -> anthropic.AsyncAnthropic:
        """Return a client for one event loop."""
        with readable_proxies():
            http_client = _transport.AsyncClient(**self._http) if self._http else anthropic.DefaultAsyncHttpxClient()
        return anthropic.AsyncAnthropic(**self._settings, http_client=http_client)

    def send(self, client: anthropic.Anthropic, request: dict[str, Any]) -> Reply:
        """Send a request and read the reply."""
        return codec.reply(client.messages.create(**request))

    async def asend(self, client: anthropic.AsyncAnthropic, request: dict[str, Any]) -> Reply:
        """Send a request and read the reply as `send` does, without blocking the event loop."""
        return codec.reply(await client.messages.create(**request))
