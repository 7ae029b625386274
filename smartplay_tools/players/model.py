"""ModelPlayer: the base class of players that ask a model over a network.

A reply takes one request, or several if the server is busy or the connection fails. Client libraries retry without
reporting how often, so a player disables their retries and makes its own: with pauses, as the server asks for them, and
with each request counted in the reply's usage. A model that cannot be reached ends the episode as `player_error`, which
is recorded and never counts as a move. Whose error it is that a server reports, `server_errors` says: a call that it
could not read is a reply of the model.

An adapter for another provider defines how a request is made and sent (`docs/other-frameworks.md`).
"""

from __future__ import annotations

import asyncio
import os
import random
import ssl
import threading
import time
import weakref
from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self
from urllib.parse import urlsplit

from smartplay_tools.errors import InvalidArgumentError, SmartPlayError
from smartplay_tools.players.attempts import Attempts
from smartplay_tools.players.cut_prompts import CutPrompts
from smartplay_tools.players.environment import is_loopback
from smartplay_tools.players.optional_fields import OptionalFields
from smartplay_tools.types import Prompt, Reply

_PLAYERS: weakref.WeakSet[ModelPlayer] = weakref.WeakSet()
_OF_PARENTS: list[object] = []
"""The clients of a parent process, never closed: a lock in one may be held by a thread that does not exist here."""


def _begin_anew() -> None:
    """In a forked process: open new connections."""
    for player in list(_PLAYERS):
        _OF_PARENTS.extend([player._in_threads, *player._in_loops.values()])
        player._begin_anew()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_begin_anew)


class ModelPlayer(ABC):
    """A player that asks a model over a network.

    Arguments:
        name: the player's name in records.
        seed: the seed of the random pauses between attempts; the model's sampling does not use it.
        retries: how many more attempts a reply may take, each a billed request.
        pause: seconds before the second attempt, unless the server asks for more; doubled for each further one.
        at_once: the most concurrent requests, in threads and in each event loop; None for no limit.

    A player may be used from several threads and event loops at the same time: hundreds of calls of `areply` in one
    event loop share one client. `close` and `aclose`, or `with` and `async with`, close the connections; a later call
    opens new ones, and so does a forked process, which must not share connections with its parent.
    """

    serves_many: ClassVar[bool] = True
    """One object plays all episodes of a run that share an event loop."""

    observations: Sequence[str] = ("text",)
    """What observations can be, for the model to play."""

    manages_context: bool = False
    """Whether each request asks the provider to manage the context, so that the model may not see the prompt."""

    optional: OptionalFields | None = None
    """The fields of a request that are left out where a server refuses them."""

    failures: tuple[type[Exception], ...] = ()
    """The exceptions of a failed request. Temporary ones are retried; any other exception is a bug."""

    def __init__(
        self, name: str, *, seed: int = 0, retries: int = 4, pause: float = 0.5, at_once: int | None = None
    ) -> None:
        if at_once is not None and at_once < 1:
            raise InvalidArgumentError(f"at_once must be at least 1, or None for no limit, not {at_once}.")
        self.name = name
        self._retries, self._pause, self._at_once = retries, pause, at_once
        self._cut_prompts = CutPrompts(name)
        self._jitter = random.Random(f"{name} {seed}")
        self._begin_anew()
        _PLAYERS.add(self)

    def _begin_anew(self) -> None:
        self._lock = threading.Lock()
        self._in_threads: _Line | None = None
        # A client's connections belong to the event loop that opened them.
        self._in_loops: weakref.WeakKeyDictionary[asyncio.AbstractEventLoop, _Line] = weakref.WeakKeyDictionary()

    # Methods that the player of a provider defines.

    @abstractmethod
    def request(self, prompt: Prompt) -> Any:
        """Return the request for a prompt; the same request is sent again if an attempt fails."""

    @abstractmethod
    def new_client(self) -> Any:
        """Return a client for threads, its own retries switched off; it is closed by its `close`."""

    @abstractmethod
    def new_async_client(self) -> Any:
        """Return a client for one event loop; its `aclose`, or else its `close`, is awaited in the end."""

    @abstractmethod
    def send(self, client: Any, request: Any) -> Reply:
        """Send a request and return the reply; raise one of the `failures` if the request fails."""

    @abstractmethod
    async def asend(self, client: Any, request: Any) -> Reply:
        """Send a request as `send` does, without blocking the event loop."""

    def failed(self, error: Exception) -> bool:
        """Whether an error is a failed attempt, and not a bug."""
        return isinstance(error, self.failures)

    def mended(self, request: Any, error: Exception) -> bool:
        """Whether the request was refused because of an optional part, which has now been removed from it."""
        return self.optional is not None and self.optional.mend(request, error)

    def check_ready(self) -> None:
        """Raise an `InvalidArgumentError` if no request can be made, for example because a key is missing."""
        try:
            client = self.new_client()
        except SmartPlayError:
            raise
        except Exception as error:
            raise InvalidArgumentError(f"{self.name} cannot be used: {str(error).partition(chr(10))[0]}") from error
        if client is not None:
            client.close()

    # The interface of players.

    def reply(self, prompt: Prompt) -> Reply:
        """Ask the model; raise `ModelCallError` if it gives no reply."""
        request, attempts, line = self.request(prompt), self._attempts(), self._line()
        while True:
            try:
                with line.room:
                    attempts.begin()
                    reply = self.send(line.client, request)
                self._cut_prompts.note(prompt.tokens, reply.usage)
                return self._counted(reply, attempts)
            except Exception as error:
                if not self.failed(error):
                    raise
                if (broken := attempts.broken_call(error)) is not None:
                    return broken
                pause = 0.0 if self.mended(request, error) else attempts.pause(error)
            time.sleep(pause)

    async def areply(self, prompt: Prompt) -> Reply:
        """Ask the model without blocking the event loop; raise `ModelCallError` if it gives no reply."""
        request, attempts, line = self.request(prompt), self._attempts(), self._async_line()
        while True:
            try:
                async with line.room:
                    attempts.begin()
                    reply = await self.asend(line.client, request)
                self._cut_prompts.note(prompt.tokens, reply.usage)
                return self._counted(reply, attempts)
            except Exception as error:
                if not self.failed(error):
                    raise
                if (broken := attempts.broken_call(error)) is not None:
                    return broken
                pause = 0.0 if self.mended(request, error) else attempts.pause(error)
            await asyncio.sleep(pause)

    def _counted(self, reply: Reply, attempts: Attempts) -> Reply:
        usage = attempts.usage(reply.usage)
        return replace(reply, usage=usage.model_copy(update={"managed": 1}) if self.manages_context else usage)

    def close(self) -> None:
        """Close the connections of `reply`."""
        with self._lock:
            line, self._in_threads = self._in_threads, None
        if line is not None and line.client is not None:
            line.client.close()

    async def aclose(self) -> None:
        """Close the connections of `areply` in this event loop, and those of `reply`."""
        self.close()
        await self.close_in_loop()

    async def close_in_loop(self) -> None:
        """Close the connections of `areply` in this event loop, as a server does before its loop ends."""
        with self._lock:
            line = self._in_loops.pop(asyncio.get_running_loop(), None)
        if line is not None and line.client is not None:
            closing = getattr(line.client, "aclose", None) or line.client.close
            await closing()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.aclose()

    def _attempts(self) -> Attempts:
        return Attempts(self._retries, self._pause, self._jitter)

    def _line(self) -> _Line:
        with self._lock:
            if self._in_threads is None:
                room = nullcontext() if self._at_once is None else threading.BoundedSemaphore(self._at_once)
                self._in_threads = _Line(self.new_client(), room)
            return self._in_threads

    def _async_line(self) -> _Line:
        loop = asyncio.get_running_loop()
        with self._lock:
            if loop not in self._in_loops:
                room = nullcontext() if self._at_once is None else asyncio.BoundedSemaphore(self._at_once)
                self._in_loops[loop] = _Line(self.new_async_client(), room)
            return self._in_loops[loop]

    @staticmethod
    def is_local(url: str) -> bool:
        """Whether a server is on this machine, so that the environment's proxies do not apply."""
        return is_loopback(urlsplit(url).hostname or "")

    @classmethod
    def http_options(cls, url: str) -> dict[str, Any]:
        """Arguments of the HTTP client for a server: the environment's proxies are not for one on this machine.

        Without TLS that client needs no certificates either, and those of a system take 25 ms to read.
        """
        if not cls.is_local(url):
            return {}
        is_plain = urlsplit(url).scheme == "http"
        return {"trust_env": False, **({"verify": ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)} if is_plain else {})}


@dataclass(frozen=True)
class _Line:
    client: Any
    room: Any
    """What a request waits for: a context manager, for event loops an asynchronous one."""
