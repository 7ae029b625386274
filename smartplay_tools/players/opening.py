"""Opening players that have connections, and closing them: what fails at the end undoes nothing that was played."""

from __future__ import annotations

from contextlib import AbstractAsyncContextManager, AbstractContextManager, AsyncExitStack, ExitStack
from functools import partial

from smartplay_tools.errors import warned_if_not_closed
from smartplay_tools.types import AsyncPlayer, Player


def enter_player(stack: ExitStack | AsyncExitStack, player: Player | AsyncPlayer) -> None:
    """Open a player, and close it with the stack; an exception of its end is a `ClosingWarning`."""
    if isinstance(player, AbstractContextManager):
        player.__enter__()
        stack.push(partial(_leave, player))


async def aenter_player(stack: AsyncExitStack, player: Player | AsyncPlayer) -> None:
    """The same on an event loop, for players that are opened there, too."""
    if isinstance(player, AbstractAsyncContextManager):
        await player.__aenter__()
        stack.push_async_exit(partial(_aleave, player))
    else:
        enter_player(stack, player)


def _leave(player: AbstractContextManager[object], *error: object) -> None:
    with warned_if_not_closed(f"The player {getattr(player, 'name', player)}"):
        player.__exit__(*error)  # type: ignore[arg-type]  # as the stack gives them


async def _aleave(player: AbstractAsyncContextManager[object], *error: object) -> None:
    with warned_if_not_closed(f"The player {getattr(player, 'name', player)}"):
        await player.__aexit__(*error)  # type: ignore[arg-type]
