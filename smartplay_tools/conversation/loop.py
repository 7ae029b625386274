"""play and aplay: the loop between a player and a conversation, synchronous and asynchronous."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias, get_args, runtime_checkable

from smartplay_tools.conversation.agent_session import Conversation
from smartplay_tools.conversation.base import BaseConversation, CheckedReply, check_episode
from smartplay_tools.episode.config import ProtocolName
from smartplay_tools.episode.episode import Episode
from smartplay_tools.errors import InvalidArgumentError, check_choice, name_of
from smartplay_tools.threads import apart_from_event_loop
from smartplay_tools.types import AsyncPlayer, EpisodeResult, ObservationForm, Player, Prompt, Reply

if TYPE_CHECKING:
    from smartplay_tools.conversation.paper import PaperConversation

__all__ = [
    "reply_of",
]


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


AnyConversation: TypeAlias = "Conversation | PaperConversation"
"""How a model plays: through tool calls, or in the paper's free text (`smartplay_tools.conversation.paper`)."""

AnyPlayer: TypeAlias = "Player | AsyncPlayer"

OnPrompt = Callable[[BaseConversation, Prompt], None]
"""Called before a prompt goes to the player; if it ends the episode, the player is not asked."""

OnTurn = Callable[[BaseConversation], None]
"""Called after every turn. The reply to a prompt for a summary is not a turn."""


@runtime_checkable
class AttachedPlayer(Protocol):
    """A player that is given the conversation before the first prompt.

    A human player reads from it what is left of the budget. A player that takes the game from it
    (`Episode.privileged_game`) is privileged, which is on record.
    """

    def attach(self, conversation: BaseConversation) -> None:
        """Take note of the conversation. It must not play."""
        ...


def play(
    episode: Episode | AnyConversation,
    player: Player | AsyncPlayer,
    *,
    protocol: ProtocolName = "tools",
    compactor_player: AnyPlayer | None = None,
    on_prompt: OnPrompt | None = None,
    on_turn: OnTurn | None = None,
) -> EpisodeResult:
    """Play an episode to its end with a player and return the result.

    The questions of a compactor are answered by `compactor_player`, by default the player itself.
    A resumed conversation (`resume`) continues after its last turn. An exception of the player ends the episode as
    `player_error`: the record contains its traceback, `EpisodeResult.error` its message, and its cost is counted if
    it has an attribute `usage`. A `PlayerLeftError` ends the episode as `closed`. A player that is only asynchronous
    runs in a new event loop.
    """
    second = player if compactor_player is None else compactor_player
    if not isinstance(player, Player) or not isinstance(second, Player):
        hooks: dict[str, Any] = {"on_prompt": on_prompt, "on_turn": on_turn, "compactor_player": compactor_player}
        playing = aplay(episode, player, protocol=protocol, **hooks)
        return apart_from_event_loop(asyncio.run, playing)
    conversation = _attach(episode, player, protocol, second)
    while (prompt := _next_prompt(conversation, on_prompt)) is not None:
        try:
            reply = _checked((second if prompt.purpose == "compaction" else player).reply(prompt))
        except Exception as error:
            conversation.give_up(error)
            break
        conversation.receive(reply)
        if on_turn is not None and prompt.purpose == "play":
            on_turn(conversation)
    return _result(conversation)


async def aplay(
    episode: Episode | AnyConversation,
    player: Player | AsyncPlayer,
    *,
    protocol: ProtocolName = "tools",
    compactor_player: AnyPlayer | None = None,
    on_prompt: OnPrompt | None = None,
    on_turn: OnTurn | None = None,
) -> EpisodeResult:
    """Play as `play` does, on a running event loop.

    Slow games, compactors, and players that are not asynchronous, run in threads.
    """
    second = player if compactor_player is None else compactor_player
    conversation = _attach(episode, player, protocol, second)
    queue = conversation.episode.ledger.queue
    while (prompt := await queue.run_to_end(lambda: _next_prompt(conversation, on_prompt))) is not None:
        try:
            reply = _checked(await reply_of(second if prompt.purpose == "compaction" else player, prompt))
        except Exception as error:
            conversation.give_up(error)
            break
        await conversation.areceive(reply)
        if on_turn is not None and prompt.purpose == "play":
            on_turn(conversation)
    return _result(conversation)


def check_player(player: object) -> None:
    """Raise an `InvalidArgumentError` that says what an object lacks to be a player."""
    kind = name_of(player)
    if isinstance(player, str):
        raise InvalidArgumentError(f"{player!r} is not a player but the name of one; pass get_player({player!r}).")
    if isinstance(player, type):
        raise InvalidArgumentError(f"{kind} is a class, not a player; pass an instance: {kind}().")
    if not any(callable(getattr(player, method, None)) for method in ("reply", "areply")):
        raise InvalidArgumentError(f"{kind} is not a player: it needs a method `reply(prompt)` or `areply(prompt)`.")
    if not isinstance(getattr(player, "name", None), str):
        raise InvalidArgumentError(
            f"{kind} needs a `name` attribute, used in records and tables; "
            f'write name = "{kind.lower()}" into the class.'
        )


def check_observation(player: object, observation: ObservationForm) -> None:
    """Raise an `InvalidArgumentError` unless a player can play from observations of this form.

    A player's attribute `observations` lists the forms from which it can play; by default, words only.
    """
    able: Sequence[str] = getattr(player, "observations", ("text",))
    if observation not in able:
        raise InvalidArgumentError(
            f'{getattr(player, "name", player)} does not play from observation="{observation}", but from '
            f"{' or '.join(able)}; a model behind OpenAI or LangChain that sees pictures has the option pictures=true, "
            "and any other player says so in its attribute `observations`."
        )


def player_versions(player: object) -> Mapping[str, str]:
    """Return what a player says of the programs and files that decide its replies, in its attribute `versions`."""
    versions: Mapping[str, str] = getattr(player, "versions", {})
    return versions


def new_conversation(
    episode: Episode, player: str, protocol: ProtocolName, versions: Mapping[str, str] | None = None
) -> AnyConversation:
    """Return a new conversation of an episode in a protocol; `versions` are the player's, for the record."""
    check_choice("protocol", protocol, get_args(ProtocolName))
    episode.ledger.player_versions = versions or {}
    if protocol == "tools":
        return Conversation(episode, player=player)
    from smartplay_tools.conversation.paper import PaperConversation

    return PaperConversation(episode, player=player)


def _attach(
    episode: Episode | AnyConversation, player: AnyPlayer, protocol: ProtocolName, second: AnyPlayer
) -> AnyConversation:
    check_player(player)
    check_player(second)
    if not isinstance(episode, BaseConversation):
        check_episode(episode)
    config = episode.config if isinstance(episode, Episode) else episode.episode.config
    check_observation(player, config.observation)
    conversation = episode
    if isinstance(conversation, Episode):
        conversation = new_conversation(conversation, player.name, protocol, player_versions(player))
    for each in (player,) if second is player else (player, second):
        if isinstance(each, AttachedPlayer):
            each.attach(conversation)
    return conversation


def _next_prompt(conversation: AnyConversation, on_prompt: OnPrompt | None) -> Prompt | None:
    prompt = conversation.prompt()
    if prompt is None or on_prompt is None:
        return prompt
    on_prompt(conversation, prompt)
    return None if conversation.episode.done else prompt


def _checked(reply: Reply) -> CheckedReply:
    """Return a player's reply in canonical form. If it is not a reply, the error counts as the player's."""
    if not isinstance(reply, Reply):
        raise InvalidArgumentError(f"A player replies with a `Reply`, not with {type(reply).__name__}.")
    return CheckedReply.of(reply)


def _result(conversation: AnyConversation) -> EpisodeResult:
    assert conversation.result is not None
    return conversation.result
