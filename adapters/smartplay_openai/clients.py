"""Clients: the `openai` client for a server, one for threads and one for every event loop.

Two of the client's habits are put right here. It sends requests for this machine through HTTP_PROXY like any other, so
the environment's proxies are left out where the server is on a loopback address (and honoured everywhere else). And it
retries in silence; here it never does, because each request is billed and must be counted (`attempts`).
"""

from __future__ import annotations

import asyncio
import os
import weakref
from functools import cached_property
from ipaddress import ip_address
from typing import Any
from urllib.parse import urlsplit

import openai

from smartplay_tools import InvalidArgumentError

DEFAULT_BASE_URL = "https://api.openai.com/v1"

LONGEST_CONNECT = 10.0
"""Seconds that a server may take to accept a connection, however long its answers may take."""


class Clients:
    """Makes and keeps the clients for a server."""

    def __init__(self, base_url: str | None, api_key: str | None, timeout: float) -> None:
        self.base_url = base_url or os.environ.get("OPENAI_BASE_URL") or DEFAULT_BASE_URL
        self.host = urlsplit(self.base_url).hostname or ""
        key = api_key or os.environ.get("OPENAI_API_KEY") or ("none" if self._is_local else None)
        if key is None:
            raise InvalidArgumentError(f"A model at {self.host} needs a key: set OPENAI_API_KEY.")
        self._settings: dict[str, Any] = {
            "base_url": self.base_url,
            "api_key": key,
            "max_retries": 0,
            "timeout": openai.Timeout(timeout, connect=min(timeout, LONGEST_CONNECT)),
        }
        # A client's connections belong to the event loop that opened them.
        self._in_loops: weakref.WeakKeyDictionary[asyncio.AbstractEventLoop, openai.AsyncOpenAI]
        self._in_loops = weakref.WeakKeyDictionary()

    @cached_property
    def in_threads(self) -> openai.OpenAI:
        """The client that blocks."""
        return openai.OpenAI(**self._settings, http_client=openai.DefaultHttpxClient(trust_env=not self._is_local))

    @property
    def in_this_loop(self) -> openai.AsyncOpenAI:
        """The client of the running event loop."""
        loop = asyncio.get_running_loop()
        if loop not in self._in_loops:
            http_client = openai.DefaultAsyncHttpxClient(trust_env=not self._is_local)
            self._in_loops[loop] = openai.AsyncOpenAI(**self._settings, http_client=http_client)
        return self._in_loops[loop]

    def close(self) -> None:
        """Close the connections of `in_threads`."""
        if "in_threads" in self.__dict__:
            self.in_threads.close()
            del self.in_threads

    async def aclose(self) -> None:
        """Close the connections of `in_this_loop`, and those of `in_threads`."""
        self.close()
        client = self._in_loops.pop(asyncio.get_running_loop(), None)
        if client is not None:
            await client.close()

    @property
    def _is_local(self) -> bool:
        try:
            return self.host == "localhost" or ip_address(self.host).is_loopback
        except ValueError:
            return False
