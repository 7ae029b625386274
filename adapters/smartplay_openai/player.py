"""The player `openai:MODEL`: a model behind OpenAI's interface, or behind any server that speaks it.

A reply takes one request, or several if the server is busy or the line is bad; what they cost is in the reply's usage.
A model that cannot be reached ends the episode as `player_error`, on the record. It is never mistaken for a move.
"""

from __future__ import annotations

import asyncio
import json
import os
import random
import time
import weakref
from collections.abc import Callable, Iterable, Mapping
from functools import cached_property
from ipaddress import ip_address
from types import TracebackType
from typing import Any, Protocol, Self
from urllib.parse import urlsplit

import openai

from smartplay_openai import chat, responses
from smartplay_openai.answers import BrokenAnswerError
from smartplay_openai.attempts import Attempts
from smartplay_tools import InvalidArgumentError, Prompt, Reply

DEFAULT_BASE_URL = "https://api.openai.com/v1"

FAILURES = (openai.OpenAIError, BrokenAnswerError, json.JSONDecodeError)
"""What a request can come to but a reply."""


class _Interface(Protocol):
    """What the modules `chat` and `responses` are."""

    def request(self, prompt: Prompt, *, limit_field: str = ...) -> dict[str, Any]: ...
    def reply(self, answer: Any, /) -> Reply: ...
    def assemble(self, parts: Iterable[Any], /) -> dict[str, Any]: ...
    def stream_options(self) -> dict[str, Any]: ...


class OpenAIPlayer:
    """A model that plays.

    Arguments:
        model: the model's name, as the server knows it.
        seed: of the pauses between attempts; what the model draws is its own affair.
        base_url: where the server is; the environment's `OPENAI_BASE_URL` if not given, then OpenAI's own.
        api_key: the key; the environment's `OPENAI_API_KEY` if not given. A server on this machine needs none.
        stream: take replies as streams, which some servers and proxies hold open longer.
        retries: how many more attempts a reply may take, each a billed request.
        pause: seconds before the second attempt, where the server does not ask for more; doubled for each further one.
        timeout: seconds that an attempt may take without a byte from the server.
        parameters: further parameters of every request, such as `{"temperature": 0}`.
        limit_field: how the server calls the cap on the reply, if not as usual: `max_completion_tokens` at OpenAI,
            `max_tokens` at other servers.

    It serves threads and event loops, many conversations at a time. `close` and `aclose`, or `with` and `async with`,
    give its connections back.
    """

    _registered = "openai"
    _interface: _Interface = chat

    def __init__(
        self,
        model: str = "",
        *,
        seed: int = 0,
        base_url: str | None = None,
        api_key: str | None = None,
        stream: bool = False,
        retries: int = 4,
        pause: float = 0.5,
        timeout: float = 300.0,
        parameters: Mapping[str, Any] | None = None,
        limit_field: str | None = None,
    ) -> None:
        if not model:
            raise InvalidArgumentError("This player needs a model: openai:MODEL.")
        self.name = f"{self._registered}:{model}"
        self.base_url = base_url or os.environ.get("OPENAI_BASE_URL") or DEFAULT_BASE_URL
        self._host = urlsplit(self.base_url).hostname or ""
        self._api_key = api_key or os.environ.get("OPENAI_API_KEY") or self._no_key()
        self._timeout, self._retries, self._pause = timeout, retries, pause
        self._jitter = random.Random(f"openai player {seed}")
        self._limit_field = limit_field or self._usual_limit_field()
        self._stream = stream
        self._every_time = {
            "model": model,
            **(self._interface.stream_options() if stream else {}),
            **(parameters or {}),
        }
        # A client's connections belong to the event loop that opened them.
        self._async_clients: weakref.WeakKeyDictionary[asyncio.AbstractEventLoop, openai.AsyncOpenAI]
        self._async_clients = weakref.WeakKeyDictionary()

    def reply(self, prompt: Prompt) -> Reply:
        """Ask the model; `ModelCallError` if it gives no reply."""
        create, request = self._create(self._client), self._request(prompt)
        attempts = Attempts(self._retries, self._pause, self._jitter)
        while True:
            try:
                attempts.begin()
                answer = create(**request)
                if self._stream:
                    with answer:
                        answer = self._interface.assemble(list(answer))
                reply = self._interface.reply(answer)
                return Reply(reply.message, attempts.usage(reply.usage))
            except FAILURES as error:
                time.sleep(attempts.pause(error))

    async def areply(self, prompt: Prompt) -> Reply:
        """Ask the model without holding up the event loop."""
        create, request = self._create(self._async_client()), self._request(prompt)
        attempts = Attempts(self._retries, self._pause, self._jitter)
        while True:
            try:
                attempts.begin()
                answer = await create(**request)
                if self._stream:
                    async with answer:
                        answer = self._interface.assemble([part async for part in answer])
                reply = self._interface.reply(answer)
                return Reply(reply.message, attempts.usage(reply.usage))
            except FAILURES as error:
                await asyncio.sleep(attempts.pause(error))

    def close(self) -> None:
        """Close the connections of `reply`."""
        if "_client" in self.__dict__:
            self._client.close()
            del self._client

    async def aclose(self) -> None:
        """Close the connections of `areply` in this event loop, and those of `reply`."""
        self.close()
        client = self._async_clients.pop(asyncio.get_running_loop(), None)
        if client is not None:
            await client.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.aclose()

    def _request(self, prompt: Prompt) -> dict[str, Any]:
        return {**self._interface.request(prompt, limit_field=self._limit_field), **self._every_time}

    def _create(self, client: Any) -> Callable[..., Any]:
        create: Callable[..., Any] = client.chat.completions.create
        return create

    def _usual_limit_field(self) -> str:
        return "max_completion_tokens" if self._host == "api.openai.com" else "max_tokens"

    def _no_key(self) -> str:
        if _is_loopback(self._host):
            return "none"
        raise InvalidArgumentError(f"A model at {self._host} needs a key: set OPENAI_API_KEY.")

    @cached_property
    def _client(self) -> openai.OpenAI:
        return openai.OpenAI(**self._settings(), http_client=openai.DefaultHttpxClient(trust_env=self._trusts_env))

    def _async_client(self) -> openai.AsyncOpenAI:
        loop = asyncio.get_running_loop()
        if loop not in self._async_clients:
            http_client = openai.DefaultAsyncHttpxClient(trust_env=self._trusts_env)
            self._async_clients[loop] = openai.AsyncOpenAI(**self._settings(), http_client=http_client)
        return self._async_clients[loop]

    @property
    def _trusts_env(self) -> bool:
        # The client would send requests for this machine through HTTP_PROXY, too; elsewhere the proxy is wanted.
        return not _is_loopback(self._host)

    def _settings(self) -> dict[str, Any]:
        where = {"base_url": self.base_url, "api_key": self._api_key}
        return {**where, "max_retries": 0, "timeout": self._timeout}


class ResponsesPlayer(OpenAIPlayer):
    """The same through the Responses interface, stateless: reasoning goes back to the model with its turn."""

    _registered = "openai-responses"
    _interface: _Interface = responses

    def _create(self, client: Any) -> Callable[..., Any]:
        create: Callable[..., Any] = client.responses.create
        return create

    def _usual_limit_field(self) -> str:
        return "max_output_tokens"


def _is_loopback(host: str) -> bool:
    """Whether a host is this machine."""
    try:
        return host == "localhost" or ip_address(host).is_loopback
    except ValueError:
        return False
