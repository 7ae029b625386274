"""A player that records its prompts in the episode of a host: it measures what another framework shows its model.

A framework that manages the context itself sends prompts that this library has not made. With this player behind an
endpoint in the place of its model, every prompt is counted and recorded as it came (`Episode.note_prompt`), and the
framework needs no change.
"""

from __future__ import annotations

from smartplay_tools.episode.episode import Episode
from smartplay_tools.types import AsyncPlayer, Player, Prompt, Reply
from smartplay_tools.types.messages import assistant_message


class NotedPlayer:
    """Asks another player, and notes every prompt and its reply in an episode with `context="host"`.

    Arguments:
        player: the player that is asked, a model or a rule.
        episode: the episode that the framework's agent plays.
    """

    def __init__(self, player: Player | AsyncPlayer, episode: Episode) -> None:
        self.name = player.name
        self._player, self._episode = player, episode

    async def areply(self, prompt: Prompt) -> Reply:
        """Ask the player; the prompt of a call that failed is not noted."""
        player = self._player
        reply = await player.areply(prompt) if isinstance(player, AsyncPlayer) else player.reply(prompt)
        self._episode.note_prompt(prompt, assistant_message(reply.message))
        return reply
