"""The player `anthropic:MODEL`: a model behind Anthropic's interface.

The client's own retries are switched off, because each attempt may be billed and it does not say how many it took.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Mapping
from types import TracebackType
from typing import Any, Self

import anthropic

from smartplay_anthropic import codec
from smartplay_tools import InvalidArgumentError, Prompt, Reply

LONGEST_PAUSE = 8.0
"""Seconds at which the pauses between attempts stop doubling."""


class AnthropicPlayer:
    """A model that plays.

    Arguments:
        model: the model's name.
        seed: unused; what a model draws is its own affair.
        base_url, api_key: the environment's `ANTHROPIC_BASE_URL` and `ANTHROPIC_API_KEY` if not given.
        limit: the cap on a reply where the budget sets none.
        retries: how many more attempts a reply may take where the server is busy or out of reach.
        pause: seconds before the second attempt, doubled for each further one.
        timeout: seconds that an attempt may take.
        parameters: further arguments of every request, such as `{"temperature": 0}`.
    """

    def __init__(
        self,
        model: str = "",
        *,
        seed: int = 0,
        base_url: str | None = None,
        api_key: str | None = None,
        limit: int = codec.LIMIT,
        retries: int = 4,
        pause: float = 0.5,
        timeout: float = 300.0,
        parameters: Mapping[str, Any] | None = None,
    ) -> None:
        if not model:
            raise InvalidArgumentError("This player needs a model: anthropic:MODEL.")
        self.name = f"anthropic:{model}"
        self._limit, self._retries, self._pause = limit, retries, pause
        self._always = {"model": model, **(parameters or {})}
        options: dict[str, Any] = {"base_url": base_url, "api_key": api_key, "timeout": timeout, "max_retries": 0}
        self._client = anthropic.Anthropic(**options)
        self._async_client = anthropic.AsyncAnthropic(**options)

    def reply(self, prompt: Prompt) -> Reply:
        """Ask the model; the client's error if it gives no reply."""
        body = {**codec.request(prompt, limit=self._limit), **self._always}
        for attempt in range(1, self._retries + 2):
            try:
                return _counted(codec.reply(self._client.messages.create(**body)), attempt)
            except anthropic.APIError as error:
                time.sleep(self._pause_after(error, attempt))
        raise AssertionError("the last attempt raises")

    async def areply(self, prompt: Prompt) -> Reply:
        """Ask the model without holding up the event loop."""
        body = {**codec.request(prompt, limit=self._limit), **self._always}
        for attempt in range(1, self._retries + 2):
            try:
                return _counted(codec.reply(await self._async_client.messages.create(**body)), attempt)
            except anthropic.APIError as error:
                await asyncio.sleep(self._pause_after(error, attempt))
        raise AssertionError("the last attempt raises")

    def close(self) -> None:
        """Close the connections of `reply`."""
        self._client.close()

    async def aclose(self) -> None:
        """Close the connections of `areply`, and those of `reply`."""
        self._client.close()
        await self._async_client.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _pause_after(self, error: anthropic.APIError, attempt: int) -> float:
        """Return the seconds to wait before the next attempt; raise the error where that is pointless."""
        status = error.status_code if isinstance(error, anthropic.APIStatusError) else 503
        if attempt > self._retries or not (status in (408, 409, 429) or status >= 500):
            raise error
        wish = error.response.headers.get("retry-after", "") if isinstance(error, anthropic.APIStatusError) else ""
        return float(wish) if wish.isdigit() else min(self._pause * 2 ** (attempt - 1), LONGEST_PAUSE)


def _counted(reply: Reply, attempts: int) -> Reply:
    usage = reply.usage and reply.usage.model_copy(update={"requests": attempts})
    return Reply(reply.message, usage)
