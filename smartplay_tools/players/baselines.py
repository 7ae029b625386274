"""Baselines of one line: what a player has to beat before its score says that it can play.

    always:ACTION     the same action at every step, by its name or its number in the manual
    win-stay          the action that was just played if it has paid, otherwise the next one in the manual
    leave-after-two   the action that was just played, unless its newest two plays in a row did not pay
    last-hand         the hand that beats the opponent's newest one
    count-last-5      the hand that beats the one which the opponent has played most often in the newest five rounds

`always` plays every game. `win-stay` and `leave-after-two` play those whose observations say what an action has paid,
the bandit and Rock Paper Scissors, and the last two Rock Paper Scissors alone. They read nothing but the observations
in the prompt, so a window limits them as it limits a model.
"""

from __future__ import annotations

import re

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.players.prompt_reading import Reading
from smartplay_tools.players.rules import bandit, rock_paper_scissors
from smartplay_tools.players.rules.rock_paper_scissors import BEATS, ROUND
from smartplay_tools.players.scripted import ActingPlayer
from smartplay_tools.types import Prompt

PAYMENT = re.compile(
    r"You pulled slot machine (\d+), you received reward (-?\d+)|You chose (\w+),.*?You (won|lost|tied)"
)
"""A machine and its reward, or a hand and its outcome."""


class AlwaysPlayer(ActingPlayer):
    """Plays one action at every step."""

    name = "always"

    def __init__(self, action: str, *, seed: int = 0) -> None:
        super().__init__(seed=seed)
        self._action = action

    def action(self, prompt: Prompt) -> str:
        """Return the action of that name or number."""
        actions = Reading(prompt).actions
        numbered = {str(number): action for number, action in enumerate(actions, start=1)}
        if self._action not in (*actions, *numbered):
            raise InvalidArgumentError(f"{self._action!r} is not an action here; play one of {', '.join(actions)}.")
        return self._action if self._action in actions else numbered[self._action]


class WinStayPlayer(ActingPlayer):
    """Win-stay, lose-shift: plays an action again that has just paid, and otherwise the next one."""

    name = "win-stay"
    losses = 1
    """After how many plays in a row that did not pay an action is left."""

    def action(self, prompt: Prompt) -> str:
        """Return the action by what the newest plays have paid; the first one, where no play is visible."""
        reading = Reading(prompt)
        actions, paid = reading.actions, _paid(reading, self.name)
        if not paid:
            return actions[0]
        newest = paid[-1][0]
        leaves = paid[-self.losses :] == [(newest, False)] * self.losses
        return actions[(actions.index(newest) + leaves) % len(actions)]


class LeaveAfterTwoPlayer(WinStayPlayer):
    """Plays one action until it has not paid twice in a row, and then the next one."""

    name = "leave-after-two"
    losses = 2


class LastHandPlayer(ActingPlayer):
    """Plays the hand that beats the one which the opponent has played most often in the newest rounds."""

    name = "last-hand"
    rounds = 1
    """How many rounds it counts."""

    def action(self, prompt: Prompt) -> str:
        """Return that hand; the first one, where no round is visible."""
        reading = Reading(prompt)
        if not rock_paper_scissors.plays(reading):
            raise InvalidArgumentError(f"{self.name} plays Rock Paper Scissors alone; play always:ACTION here.")
        hands = [match[1] for text in reading.observations if (match := ROUND.search(text))][-self.rounds :]
        beaten = max(BEATS, key=hands.count)
        return next(hand for hand, loser in BEATS.items() if loser == beaten) if hands else reading.actions[0]


class CountLastFivePlayer(LastHandPlayer):
    """`last-hand` that counts five rounds."""

    name = "count-last-5"
    rounds = 5


def _paid(reading: Reading, player: str) -> list[tuple[str, bool]]:
    """The visible plays, oldest first, and whether each has paid."""
    if not bandit.plays(reading) and not rock_paper_scissors.plays(reading):
        raise InvalidArgumentError(
            f"{player} cannot see what an action has paid in this game; it plays the bandit and Rock Paper Scissors. "
            "Play always:ACTION here."
        )
    plays = filter(None, map(PAYMENT.search, reading.observations))
    return [(reading.actions[int(m[1]) - 1], int(m[2]) > 0) if m[1] else (m[3], m[4] == "won") for m in plays]
