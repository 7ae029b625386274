"""A game, a player and a server's error whose words would do something to a terminal."""

from __future__ import annotations

from typing import Any

import gymnasium

import smartplay_tools as sp
from smartplay_tools.games import GymnasiumGame

COMMANDS = "\x1b]0;owned\x07 \x00\x08\r\x7f\x9b2J \u202etxt\u2069 [/red] $x^$"
"""Sets a title, clears the screen, hides, turns the direction; no markup and no formula."""

HOSTILE = COMMANDS + " \ud83d"
"""And half a character."""


class Ice(GymnasiumGame):
    """Gymnasium's lake, which colours the place where the player is."""

    actions = ("Left", "Down", "Right", "Up")
    manual = "Cross the lake."

    def make_env(self) -> gymnasium.Env[Any, Any]:
        return gymnasium.make("FrozenLake-v1", render_mode="ansi", is_slippery=False)

    def describe(self, observation: int, info: dict[str, Any]) -> str:
        return f"{self.env.render()}{COMMANDS}"


SPEC = sp.GameSpec(
    id="Ice-v0", family="ice", entry_point=Ice, history=2, rollout=3, trials=2, score_bounds=(0, 1), worst_step=0
)


class Speaking:
    """A player that says the worst in every field of its replies."""

    name = "speaking"

    def __init__(self, *, seed: int = 0) -> None:
        self.replies = 0

    def reply(self, prompt: sp.Prompt) -> sp.Reply:
        self.replies += 1
        name, arguments = [("act", '{"action": "Right"}'), (HOSTILE, HOSTILE)][self.replies % 2]
        call = {"id": HOSTILE, "type": "function", "function": {"name": name, "arguments": arguments}}
        return sp.Reply({"role": "assistant", "content": HOSTILE, "tool_calls": [call]})


class Failing(Speaking):
    """A player whose server answers with an error."""

    name = "failing"

    def reply(self, prompt: sp.Prompt) -> sp.Reply:
        raise ConnectionError(HOSTILE)
