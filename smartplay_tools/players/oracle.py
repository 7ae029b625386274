"""The oracle: plays the best action, computed from the game's state; an upper bound for games with a known optimum.

It is privileged: it takes the game from its episode (`Episode.privileged_game`), and every record and result of its
play notes this. In the bandit it always pulls the better machine, in Rock Paper Scissors it plays the hand that is best
against the opponent's true probabilities, in Hanoi it makes the next move of the shortest solution.
"""

from __future__ import annotations

from smartplay_tools.conversation.base import BaseConversation
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.games.base import TextGame
from smartplay_tools.players.prompt_reading import call
from smartplay_tools.types import Prompt, Reply


class OraclePlayer:
    """Plays `TextGame.optimal_action`."""

    name = "oracle"
    observations = ("text", "picture", "both")

    def __init__(self, *, seed: int = 0) -> None:
        """Every player takes a seed; this one draws nothing."""
        self._game: TextGame | None = None

    def attach(self, conversation: BaseConversation) -> None:
        """Take the game from the conversation's episode; raise `InvalidArgumentError` if no optimum is known for it."""
        if conversation.episode.game.optimal_action is None:
            raise InvalidArgumentError(
                f"No optimum is known for {conversation.episode.spec.id}: the oracle plays bandits, Rock Paper "
                "Scissors and Hanoi. The best player for the other games is rule."
            )
        self._game = conversation.episode.privileged_game()

    def reply(self, prompt: Prompt) -> Reply:
        """Play the best action."""
        if self._game is None:
            raise InvalidArgumentError(
                "The oracle needs the game, so it must be attached to a conversation: use `play`, `aplay` or eval."
            )
        action = self._game.optimal_action
        assert action is not None
        name = self._game.actions[action]
        return Reply(call("act", action=name) if prompt.tools else {"role": "assistant", "content": name})
