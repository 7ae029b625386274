"""Calls moved to another thread: of code that runs an event loop where one already runs, or that would block one."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import ParamSpec, TypeVar

from smartplay_tools.types import AsyncPlayer, Player, Prompt, Reply

__all__ = ["apart_from_event_loop", "reply_of"]

Given = ParamSpec("Given")
T = TypeVar("T")


def apart_from_event_loop(call: Callable[Given, T], /, *args: Given.args, **kwargs: Given.kwargs) -> T:
    """Call a function that runs its own event loop; if this thread already runs one, in another thread.

    A notebook runs its cells on an event loop. Signals still reach this thread while it waits, so Ctrl-C and the
    notebook's stop button stop a run between two turns as they do elsewhere.
    """
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return call(*args, **kwargs)
    thread = ThreadPoolExecutor(1, "smartplay-tools run")
    try:
        return thread.submit(call, *args, **kwargs).result()
    finally:
        thread.shutdown(wait=False)


async def reply_of(player: Player | AsyncPlayer, prompt: Prompt) -> Reply:
    """Return a player's reply without blocking the event loop: one that cannot be awaited is asked in a thread."""
    if isinstance(player, AsyncPlayer):
        return await player.areply(prompt)
    return await asyncio.to_thread(_blocking, player, prompt)


def _blocking(player: Player, prompt: Prompt) -> Reply:
    try:
        return player.reply(prompt)
    except StopIteration as error:  # StopIteration, which no coroutine may raise: its caller would wait forever
        raise RuntimeError("The player has no more replies.") from error
