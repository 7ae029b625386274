"""The player `openai:MODEL`: a model behind OpenAI's interface, or behind any server that speaks it.

A reply takes one request, or several if the server is busy or the line is bad; what they cost is in the reply's usage.
A model that cannot be reached ends the episode as `player_error`, on the record. It is never mistaken for a move.
"""

from __future__ import annotations

import asyncio
import json
import random
import time
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from types import TracebackType
from typing import Any, ClassVar, Protocol, Self

import openai

from smartplay_openai import chat, responses
from smartplay_openai.answers import BrokenAnswerError
from smartplay_openai.attempts import Attempts
from smartplay_openai.clients import Clients
from smartplay_tools import InvalidArgumentError, Prompt, Reply

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
        parameters: further fields of every request, such as `{"temperature": 0}`.
        limit_field: how the server calls the cap on the reply, if not as usual: `max_completion_tokens` at OpenAI,
            `max_tokens` at other servers.

    It serves threads and event loops, many conversations at a time. `close` and `aclose`, or `with` and `async with`,
    give its connections back.
    """

    serves_many: ClassVar[bool] = True
    """One object serves all episodes of a run on an event loop."""

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
            raise InvalidArgumentError(f"This player needs a model: {self._registered}:MODEL.")
        self.name = f"{self._registered}:{model}"
        self._clients = Clients(base_url, api_key, timeout)
        self._new_attempts = partial(Attempts, retries, pause, random.Random(f"openai player {seed}"))
        self._limit_field = limit_field or self._usual_limit_field()
        self._stream = stream
        self._always = {"model": model, **(self._interface.stream_options() if stream else {}), **(parameters or {})}

    def reply(self, prompt: Prompt) -> Reply:
        """Ask the model; `ModelCallError` if it gives no reply."""
        body = self.request(prompt)
        ask = self._ask(self._clients.in_threads, body)
        attempts = self._new_attempts()
        while True:
            try:
                attempts.begin()
                answer = ask()
                if self._stream:
                    with answer:
                        answer = self._interface.assemble(list(answer))
                reply = self._interface.reply(answer)
                return Reply(reply.message, attempts.usage(reply.usage))
            except FAILURES as error:
                if not self._mended(body, error):
                    time.sleep(attempts.pause(error))

    async def areply(self, prompt: Prompt) -> Reply:
        """Ask the model without holding up the event loop."""
        body = self.request(prompt)
        ask = self._ask(self._clients.in_this_loop, body)
        attempts = self._new_attempts()
        while True:
            try:
                attempts.begin()
                answer = await ask()
                if self._stream:
                    async with answer:
                        answer = self._interface.assemble([part async for part in answer])
                reply = self._interface.reply(answer)
                return Reply(reply.message, attempts.usage(reply.usage))
            except FAILURES as error:
                if not self._mended(body, error):
                    await asyncio.sleep(attempts.pause(error))

    def request(self, prompt: Prompt) -> dict[str, Any]:
        """Return the body of the request that a prompt becomes."""
        return {**self._interface.request(prompt, limit_field=self._limit_field), **self._always}

    def close(self) -> None:
        """Close the connections of `reply`."""
        self._clients.close()

    async def aclose(self) -> None:
        """Close the connections of `areply` in this event loop, and those of `reply`."""
        await self._clients.aclose()

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

    def _ask(self, client: openai.OpenAI | openai.AsyncOpenAI, body: dict[str, Any]) -> Callable[[], Any]:
        # As `extra_body` the client sends it as it stands. As typed arguments it would first compare every message
        # with every type that a message can have, which takes it ten times as long as the request itself.
        typed: dict[str, Any] = {"model": body["model"], "stream": self._stream}
        return partial(self._create(client), **typed, extra_body=body)

    def _create(self, client: openai.OpenAI | openai.AsyncOpenAI) -> Callable[..., Any]:
        return partial(client.chat.completions.create, messages=[])

    def _mended(self, body: dict[str, Any], error: Exception) -> bool:
        """Whether the request was refused for something that it can do without, and now does."""
        return False

    def _usual_limit_field(self) -> str:
        return "max_completion_tokens" if self._clients.host == "api.openai.com" else "max_tokens"


class ResponsesPlayer(OpenAIPlayer):
    """The same through the Responses interface, stateless: reasoning goes back to the model with its turn."""

    _registered = "openai-responses"
    _interface: _Interface = responses

    def _create(self, client: openai.OpenAI | openai.AsyncOpenAI) -> Callable[..., Any]:
        create: Callable[..., Any] = client.responses.create
        return create

    def _mended(self, body: dict[str, Any], error: Exception) -> bool:
        # A model that does not reason has no reasoning to give, and refuses to be asked for it.
        refused = isinstance(error, openai.BadRequestError) and "encrypted content" in str(error).lower()
        if refused and body.get("include"):
            body["include"] = self._always["include"] = []
            return True
        return False

    def _usual_limit_field(self) -> str:
        return "max_output_tokens"
