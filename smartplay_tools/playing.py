"""play and aplay: the loop between a player and a conversation, ten lines each."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from smartplay_tools.conversation import Conversation
from smartplay_tools.episode import Episode
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.messages import assistant_message
from smartplay_tools.records import AsyncPlayer, EpisodeResult, Player, Reply

OnTurn = Callable[[Conversation], None]
"""Called after every reply, to look on."""


def play(episode: Episode, player: Player, *, on_turn: OnTurn | None = None) -> EpisodeResult:
    """Have a player play an episode to its end and return the result.

    An exception of the player ends the episode as `player_error`; it is in the record, with its traceback, and its
    message in `EpisodeResult.error`.
    """
    if not isinstance(player, Player):
        raise InvalidArgumentError(f"{player!r} cannot `reply`; drive an asynchronous player with `aplay`.")
    conversation = Conversation(episode, player=player.name)
    while (prompt := conversation.prompt()) is not None:
        try:
            reply = _checked(player.reply(prompt))
        except Exception as error:
            episode.end("player_error", error)
            break
        conversation.receive(reply.message, reply.usage)
        if on_turn is not None:
            on_turn(conversation)
    return _result(conversation)


async def aplay(episode: Episode, player: AsyncPlayer | Player, *, on_turn: OnTurn | None = None) -> EpisodeResult:
    """Do the same on an event loop; the game's steps, and a player that is not asynchronous, run in threads."""
    conversation = Conversation(episode, player=player.name)
    while (prompt := await asyncio.to_thread(conversation.prompt)) is not None:
        try:
            if isinstance(player, AsyncPlayer):
                reply = _checked(await player.areply(prompt))
            else:
                reply = _checked(await asyncio.to_thread(player.reply, prompt))
        except Exception as error:
            episode.end("player_error", error)
            break
        await asyncio.to_thread(conversation.receive, reply.message, reply.usage)
        if on_turn is not None:
            on_turn(conversation)
    return _result(conversation)


def _checked(reply: Reply) -> Reply:
    """Refuse what is not a reply while it still counts as the player's fault."""
    return Reply(assistant_message(reply.message), reply.usage)


def _result(conversation: Conversation) -> EpisodeResult:
    assert conversation.result is not None
    return conversation.result
