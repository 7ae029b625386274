"""Players that need no model: for tests, for lower and upper bounds of scores, and to measure other frameworks.

`ScriptedPlayer` gives prepared replies.

`FirstPlayer` always plays the first action of the game. The original plays this action, without reporting it, if it
finds no action in a model's answer, so the player scores as much as a model whose answers never name an action.

`RandomPlayer` draws a legal action at every prompt, a lower bound for other players. It calls a tool if the prompt has
tools, and otherwise answers with the action's name (the paper's protocol).

`OraclePlayer` plays the best action, computed from the game's state, an upper bound for games with a known optimum: in
the bandit it always pulls the better machine, in Rock Paper Scissors it plays the hand that is best against the
opponent's true probabilities, in Hanoi it makes the next move of the shortest solution. It is privileged: it takes the
game from its episode (`Episode.privileged_game`), and every record and result of its play notes this.

`NotedPlayer` records the prompts of another player in the episode of a host. A framework that manages the context
itself sends prompts that this library has not made. With this player behind an endpoint in the place of its model,
every prompt is counted and recorded as it came (`Episode.note_prompt`), and the framework needs no change.
"""

from __future__ import annotations

import random
from abc import ABC, abstractmethod
from collections.abc import Iterable

from smartplay_tools.conversation.base import BaseConversation
from smartplay_tools.episode.episode import Episode
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.games.base import TextGame
from smartplay_tools.players.prompt_reading import Reading, call
from smartplay_tools.players.rules.memory import newest_quoted
from smartplay_tools.types import AsyncPlayer, Player, Prompt, Reply, Usage
from smartplay_tools.types.messages import Message, assistant_message


class ScriptedPlayer:
    """Gives replies, or the replies of messages, in order, and stores the prompts that it received in `prompts`."""

    name = "scripted"
    observations = ("text", "picture", "both")

    def __init__(self, messages: Iterable[Message | Reply], usage: Usage | None = None) -> None:
        self._messages = iter(messages)
        self._usage = usage
        self.prompts: list[Prompt] = []

    def reply(self, prompt: Prompt) -> Reply:
        """Return the next message as a reply; raise StopIteration when there is no further message."""
        self.prompts.append(prompt)
        given = next(self._messages)
        return given if isinstance(given, Reply) else Reply(given, self._usage)


class ActingPlayer(ABC):
    """Plays one action at each prompt. Asked for words, it repeats the newest notes that the prompt quotes."""

    name: str
    observations = ("text", "picture", "both")

    def __init__(self, *, seed: int = 0) -> None:  # noqa: B027 - not abstract: most draw nothing
        """Every player takes a seed, whether it draws anything or not."""

    def reply(self, prompt: Prompt) -> Reply:
        """Call the tool for the action or, without tools, answer with its name."""
        if prompt.purpose != "play":
            notes = newest_quoted(Reading(prompt))
            return Reply(
                {"role": "assistant", "content": "I keep no memory of what leaves." if notes is None else notes}
            )
        action = self.action(prompt)
        return Reply(call("act", action=action) if prompt.tools else {"role": "assistant", "content": action})

    @abstractmethod
    def action(self, prompt: Prompt) -> str:
        """Return the name of the action to play."""


DOING_NOTHING = "Noop"
"""Crafter's manual lists it last, but it is the first action of the game, which is what the original falls back to."""


class FirstPlayer(ActingPlayer):
    """Plays the game's first action, by name."""

    name = "first"

    def action(self, prompt: Prompt) -> str:
        """Return the first action."""
        actions = Reading(prompt).actions
        return DOING_NOTHING if DOING_NOTHING in actions else actions[0]


class RandomPlayer(ActingPlayer):
    """Plays any legal action with equal probability, from its own seeded generator."""

    name = "random"

    def __init__(self, *, seed: int = 0) -> None:
        # String seeds are hashed by a fixed algorithm, and this one gives another stream than the game's.
        self._random = random.Random(f"random player {seed}")

    def action(self, prompt: Prompt) -> str:
        """Return a legal action."""
        return self._random.choice(Reading(prompt).actions)


class OraclePlayer(ActingPlayer):
    """Plays `TextGame.optimal_action`."""

    name = "oracle"
    _game: TextGame | None = None

    def attach(self, conversation: BaseConversation) -> None:
        """Take the game from the conversation's episode; raise `InvalidArgumentError` if no optimum is known for it."""
        if conversation.episode.game.optimal_action is None:
            raise InvalidArgumentError(
                f"No optimum is known for {conversation.episode.spec.id}: the oracle plays bandits, Rock Paper "
                "Scissors and Hanoi. The best player for the other games is rule."
            )
        self._game = conversation.episode.privileged_game()

    def action(self, prompt: Prompt) -> str:
        """Return the best action."""
        if self._game is None:
            raise InvalidArgumentError(
                "The oracle needs the game, so it must be attached to a conversation: use `play`, `aplay` or eval."
            )
        action = self._game.optimal_action
        assert action is not None
        return self._game.actions[action]


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
