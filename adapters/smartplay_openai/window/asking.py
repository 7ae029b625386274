"""Asks a player for a reply, whether it is awaited or not."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from smartplay_tools import AsyncPlayer, Player, Prompt, Reply


async def ask(player: Player | AsyncPlayer, prompt: Prompt) -> Reply:
    """Return a player's reply, without blocking the event loop."""
    if isinstance(player, AsyncPlayer):
        return await player.areply(prompt)
    return await asyncio.to_thread(_blocking, player.reply, prompt)


def _blocking(reply: Callable[[Prompt], Reply], prompt: Prompt) -> Reply:
    try:
        return reply(prompt)
    except StopIteration as error:  # which no coroutine may raise
        raise RuntimeError("The player has no more replies.") from error
