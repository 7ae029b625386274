"""The rule player: one name for all rule players; the messages tell which of them has to play."""

from __future__ import annotations

from smartplay_tools.players.reading import Reading
from smartplay_tools.players.rules import bandit, hanoi, minecraft, rock_paper_scissors
from smartplay_tools.records import Prompt, Reply

RULES = (bandit, hanoi, minecraft, rock_paper_scissors)


class RulePlayer:
    """Plays by rules written for each game, from nothing but the messages of the prompt."""

    name = "rule"

    def __init__(self, *, seed: int = 0) -> None:
        """Every player takes a seed; this one draws nothing."""

    def reply(self, prompt: Prompt) -> Reply:
        """Decide by the rules of the game whose actions the prompt offers."""
        reading = Reading(prompt)
        for rules in RULES:
            if rules.plays(reading):
                return Reply(rules.decide(reading))
        raise ValueError(f"The rule player has no rules for a game with the actions {', '.join(reading.actions)}.")
