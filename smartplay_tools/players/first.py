"""The first player: always plays the first action of the game.

The original plays this action, without reporting it, if it finds no action in a model's answer. This player therefore
scores as much as a model whose answers never name an action. It reads messages only.
"""

from __future__ import annotations

from smartplay_tools.players.prompt_reading import Reading, call
from smartplay_tools.types import Prompt, Reply

DOING_NOTHING = "Noop"
"""Crafter's manual lists it last, but it is the first action of the game, which is what the original falls back to."""


class FirstPlayer:
    """Plays the game's first action, by name."""

    name = "first"
    observations = ("text", "picture", "both")

    def __init__(self, *, seed: int = 0) -> None:
        """Every player takes a seed; this one draws nothing."""

    def reply(self, prompt: Prompt) -> Reply:
        """Play the first action."""
        actions = Reading(prompt).actions
        action = DOING_NOTHING if DOING_NOTHING in actions else actions[0]
        return Reply(call("act", action=action) if prompt.tools else {"role": "assistant", "content": action})
