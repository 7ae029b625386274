"""The random player: a legal action, drawn at every prompt; a lower bound for other players.

It calls a tool if the prompt has tools, and otherwise answers with the action's name (the paper's protocol).
"""

from __future__ import annotations

import random

from smartplay_tools.players.prompt_reading import Reading, call
from smartplay_tools.types import Prompt, Reply


class RandomPlayer:
    """Plays any legal action with equal probability, from its own seeded generator."""

    name = "random"
    observations = ("text", "picture", "both")

    def __init__(self, *, seed: int = 0) -> None:
        # String seeds are hashed by a fixed algorithm, and this one gives another stream than the game's.
        self._random = random.Random(f"random player {seed}")

    def reply(self, prompt: Prompt) -> Reply:
        """Play a legal action."""
        action = self._random.choice(Reading(prompt).actions)
        return Reply(call("act", action=action) if prompt.tools else {"role": "assistant", "content": action})
