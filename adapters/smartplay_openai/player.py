"""The players `openai:MODEL` and `openai-responses:MODEL`: models behind OpenAI's interface or a compatible server.

Two defaults of the client are changed. It sends requests for this machine through HTTP_PROXY like any other, so the
environment's proxies are not used if the server is on a loopback address (they are used for all others). It retries
without reporting it, so its retries are switched off, and `ModelPlayer` retries instead.
"""

from __future__ import annotations

import importlib
import inspect
import json
import os
import re
from collections.abc import Callable, Mapping
from typing import Any
from urllib.parse import urlsplit

from smartplay_tools.errors import extra_named

with extra_named("smartplay_openai", "openai"):
    import openai
    from openai.resources.chat.completions import Completions
    from openai.resources.responses import Responses

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
from smartplay_tools.players.wire import CHAT, RESPONSES, Interface
from smartplay_tools.providers.cache_fields import openai_cache_fields
from smartplay_tools.providers.caps import cap_at
from smartplay_tools.types.arguments import object_in

_transport = importlib.import_module(openai.DefaultHttpxClient.__mro__[1].__module__)
"""The HTTP library of the client: `httpx` up to version 2, `httpx2` from version 3 on."""

DEFAULT_BASE_URL = "https://api.openai.com/v1"

LONGEST_CONNECT = 10.0
"""Seconds that a server may take to accept a connection, however long its answers may take."""


def arguments_of(method: Callable[..., Any]) -> frozenset[str]:
    """Return the names of the arguments that a client's method has for fields of a request."""
    names = inspect.signature(method).parameters
    return frozenset(name for name in names if not name.startswith("extra_") and name not in ("self", "timeout"))


_DATA = re.compile("^data:(.*)$", re.MULTILINE)


def _is_whole(stream: Any) -> bool:
    """Whether a server has answered as a whole although a stream was asked for."""
    return "json" in stream.response.headers.get("content-type", "")


class OpenAIPlayer(ModelPlayer):
    """A player that asks a model behind OpenAI's chat completions.

    Arguments:
        model: the model's name on the server.
        base_url: the server; by default the environment's `OPENAI_BASE_URL`, then OpenAI's own.
        api_key: the key; by default the environment's `OPENAI_API_KEY`. A server on this machine needs none.
        stream: receive replies as streams, for which some servers and proxies have longer timeouts.
        timeout: seconds that an attempt may take without a byte from the server.
        parameters: further fields of every request, such as `{"temperature": 0}`; a cap on the reply among them applies
            where it is smaller than the budget's.
        limit_field: the server's name of the cap on the reply; by default the one in its provider's file, and
            another if the server refuses it.
        typed: pass the fields that the client knows as arguments, so that tracers and other wrappers of the client see
            messages and tools. The client then compares every message with every type of message, which takes about
            1 ms for each turn in the window; False sends the body unchanged.
        cache: say to OpenAI which prompts belong together (`prompt_cache_key`), and mark the end of the part that is
            unchanged since the previous prompt for models that cache up to marks. Other servers are sent neither.
        pictures: whether the model sees pictures, which many servers accept and do not show; without it, episodes whose
            observations are pictures are refused.
        tool_choice: "required" has the server make every reply a call; a summary is asked for without tools.
        options: those of `ModelPlayer`: `seed`, `retries`, `pause`, `at_once`.
    """

    # Version 2 of the client raises the transport's own errors if a body or a stream ends early.
    failures = (openai.OpenAIError, _transport.TransportError, BrokenAnswerError, json.JSONDecodeError)

    optional: OptionalFields
    _registered = "openai"
    _interface: Interface = CHAT
    _arguments_of_client = arguments_of(Completions.create)

    def __init__(
        self,
        model: str = "",
        *,
        base_url: str | None = None,
        api_key: str | None = None,
        stream: bool = False,
        timeout: float = 300.0,
        parameters: Mapping[str, Any] | None = None,
        limit_field: str | None = None,
        typed: bool = True,
        cache: bool = True,
        tool_choice: str | None = None,
        pictures: bool = False,
        **options: Any,
    ) -> None:
        if not model:
            raise InvalidArgumentError(f"This player needs a model: {self._registered}:MODEL.")
        super().__init__(f"{self._registered}:{model}", **options)
        self.observations = ("text", "picture", "both") if pictures else ("text",)
        given = "--base-url" if base_url else "OPENAI_BASE_URL"
        base_url = base_url or os.environ.get("OPENAI_BASE_URL") or DEFAULT_BASE_URL
        check_url(base_url, given)
        self._host, self._http = urlsplit(base_url).hostname or "", self.http_options(base_url)
        self._settings: dict[str, Any] = {
            "base_url": base_url,
            "api_key": api_key or os.environ.get("OPENAI_API_KEY") or ("none" if self.is_local(base_url) else None),
            "max_retries": 0,
            "timeout": openai.Timeout(timeout, connect=min(timeout, LONGEST_CONNECT)),
        }
        if self._settings["api_key"] is None:
            raise InvalidArgumentError(f"A model at {self._host} needs a key: set OPENAI_API_KEY.")
        check_key(self._settings["api_key"], self.name)
        usual = cap_at(base_url) if self._interface is CHAT else self._interface.limit_field
        self._limit_field = limit_field or usual
        own = [*(parameters or {}), *([] if limit_field is None else [limit_field])]
        self.optional, self.manages_context = OptionalFields(self.name, own), asks_management(parameters)
        self._stream, self._typed = stream, typed
        fields = openai_cache_fields(model, base_url)
        self._sends_key, self._marks = cache and fields.key, cache and fields.marks
        self._always = {"model": model, **(self._interface.stream_options if stream else {}), **(parameters or {})}
        if tool_choice is not None:
            self._always["tool_choice"] = tool_choice

    def request(self, prompt: Prompt) -> dict[str, Any]:
        """Return the body of the request for a prompt."""
        own = {"prompt_cache_key": prompt.cache_key, **self._always} if self._sends_key else self._always
        request = self._interface.request(prompt, limit_field=self._limit_field, own=own, mark=self._marks)
        return self.optional.fit(request)

    def new_client(self) -> openai.OpenAI:
        """Return a synchronous client."""
        with readable_proxies():
            http_client = openai.DefaultHttpxClient(**self._http)
        return openai.OpenAI(**self._settings, http_client=http_client)

    def new_async_client(self) -> openai.AsyncOpenAI:
        """Return a client for one event loop."""
        with readable_proxies():
            http_client = openai.DefaultAsyncHttpxClient(**self._http)
        return openai.AsyncOpenAI(**self._settings, http_client=http_client)

    def send(self, client: openai.OpenAI, request: dict[str, Any]) -> Reply:
        """Send a request and read the reply, or its stream."""
        try:
            answer = self._interface.create(client)(**self._arguments(request))
            if self._stream:
                with answer:
                    is_whole = _is_whole(answer)
                    answer = answer.response.read().decode() if is_whole else self._interface.assemble(list(answer))
        except (json.JSONDecodeError, UnicodeDecodeError) as error:
            answer = getattr(error, "doc", "")
        return self._read(answer)

    async def asend(self, client: openai.AsyncOpenAI, request: dict[str, Any]) -> Reply:
        """Send a request as `send` does, without blocking the event loop."""
        try:
            answer = await self._interface.create(client)(**self._arguments(request))
            if self._stream:
                async with answer:
                    is_whole = _is_whole(answer)
                    parts = [] if is_whole else [part async for part in answer]
                    whole = await answer.response.aread() if is_whole else b""
                    answer = whole.decode() if is_whole else self._interface.assemble(parts)
        except (json.JSONDecodeError, UnicodeDecodeError) as error:
            answer = getattr(error, "doc", "")
        return self._read(answer)

    def _read(self, answer: Any) -> Reply:
        if isinstance(answer, str):
            answer = self._read_text(answer)
        return self._interface.reply(answer)

    def _read_text(self, text: str) -> dict[str, Any]:
        """The answer in a text that the client did not read: a stream that was not asked for, or the reverse."""
        events = [data.strip() for data in _DATA.findall(text) if data.strip() != "[DONE]"]
        parts = [object_in(data) for data in events]
        if parts and None not in parts:
            return self._interface.assemble(parts)
        if (answer := object_in(text)) is not None:
            return answer
        what = "HTML" if text.lstrip()[:1] == "<" else "something that is not JSON"
        raise BrokenAnswerError(f"{self._settings['base_url']} answered with {what}; {self.address_hint}")

    @property
    def address_hint(self) -> str:
        """What to look at if an address is not the interface's."""
        is_short = not urlsplit(self._settings["base_url"]).path.rstrip("/")
        return "the base URL usually ends in /v1, which this one does not" if is_short else "check the base URL"

    def _arguments(self, body: dict[str, Any]) -> dict[str, Any]:
        """The arguments of the client's method; fields for which it has no argument are in `extra_body`."""
        if not self._typed:
            return {**self._interface.required, "model": body["model"], "stream": self._stream, "extra_body": body}
        fields = self._arguments_of_client
        typed = {field: value for field, value in body.items() if field in fields}
        extra = {field: value for field, value in body.items() if field not in fields}
        return {**typed, "extra_body": extra} if extra else typed


class ResponsesPlayer(OpenAIPlayer):
    """A player that asks a model through the stateless Responses interface; reasoning is sent back with its turn."""

    _registered = "openai-responses"
    _interface: Interface = RESPONSES
    _arguments_of_client = arguments_of(Responses.create)
