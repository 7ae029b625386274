"""Rock Paper Scissors (paper section 3.3): fifty rounds against an opponent with fixed but hidden probabilities."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from itertools import accumulate, permutations
from typing import Any

from numpy.random import Generator

from smartplay_tools.games.base import TextGame, read_text, with_action_list
from smartplay_tools.types.sums import added

# --- Rules -----------------------------------------------------------------------------------------------------------

HANDS = 3
"""Rock, Paper, Scissor are 0, 1, 2: each hand beats the one before it, and Rock beats Scissor."""


@dataclass(frozen=True)
class Table:
    """For each hand in this episode, the opponent's probability of playing it and the score of a win with it."""

    probabilities: tuple[float, ...]
    scores: tuple[int, ...]

    def expected_reward(self, hand: int) -> float:
        """The mean reward of a round in which `hand` is played."""
        return added(p * reward(self, hand, other) for other, p in enumerate(self.probabilities))


def shuffle(table: Table, chance: Generator) -> Table:
    """Assign the (probability, score) pairs to the hands in random order; all orders are equally likely."""
    orders = list(permutations(zip(table.probabilities, table.scores, strict=True)))
    pairs = orders[int(chance.random() * len(orders))]
    return Table(tuple(p for p, _ in pairs), tuple(s for _, s in pairs))


def opponent_hand(table: Table, chance: Generator) -> int:
    """Draw the opponent's hand."""
    edges = list(accumulate(table.probabilities))[:-1]
    return bisect_right(edges, chance.random())


def reward(table: Table, hand: int, other: int) -> int:
    """The score of a win with `hand`, minus the score of the opponent's win with `other`, 0 for a draw."""
    if hand == other:
        return 0
    return table.scores[hand] if (hand - other) % HANDS == 1 else -table.scores[other]


def best(table: Table) -> int:
    """Return the hand with the largest expected reward, the optimal action of every step."""
    return max(range(HANDS), key=table.expected_reward)


# --- Text ------------------------------------------------------------------------------------------------------------

ACTIONS = ("Rock", "Paper", "Scissor")
START = "New round begins."


def manual(scores: tuple[int, ...]) -> str:
    """The manual with the score of each hand."""
    rock, paper, scissors = scores
    rules = read_text(__package__, "rock_paper_scissors.txt").format(rock=rock, paper=paper, scissors=scissors)
    return with_action_list(rules, ACTIONS)


def describe(hand: int, other: int, score: int) -> str:
    """The observation after a round; `score` is its reward. The original's word for a draw is "tied"."""
    outcome = "tied" if hand == other else "won" if (hand - other) % HANDS == 1 else "lost"
    return (
        f"You chose {ACTIONS[hand]}, and the opponent chose {ACTIONS[other]}. "
        f"You {outcome} and received score {score}.\n{START}"
    )


# --- Environment -----------------------------------------------------------------------------------------------------


class RockPaperScissors(TextGame):
    """Rock Paper Scissors against a biased opponent.

    Action space: `Discrete(3)`: rock, paper, scissors. Observation: both hands and the score of the round. Reward:
    that score. Score: the number of rounds in which the hand of largest expected reward was played. The game never
    ends by itself; a rollout has 50 steps.

    Arguments: `probabilities` and `scores`, dealt in pairs to the three hands at every reset. The manual states the
    scores of the current episode.
    """

    actions = ACTIONS

    def __init__(
        self, *, probabilities: tuple[float, float, float], scores: tuple[int, int, int], **options: Any
    ) -> None:
        self._setting = self._table = Table(tuple(probabilities), tuple(scores))
        self.manual = manual(self._table.scores)
        super().__init__(**options)

    def drawing(self) -> dict[str, Any]:
        """The hands of the latest round, the player's first, and the opponent's true probabilities."""
        table = {"odds": list(self._table.probabilities), "scores": list(self._table.scores), "best": self._best}
        return {"hands": self._hands, **table}

    @property
    def optimal_action(self) -> int:
        """The hand with the largest expected reward against the true opponent."""
        return self._best

    def _reset(self) -> str:
        self._hands: list[int] = []
        self._table = shuffle(self._setting, self.np_random)
        self._best = best(self._table)
        self.manual = manual(self._table.scores)
        return START

    def _step(self, action: int) -> tuple[str, float, bool, bool]:
        other = opponent_hand(self._table, self.np_random)
        score = reward(self._table, action, other)
        self._hands = [action, other]
        self.score += action == self._best
        return describe(action, other, score), score, False, False

    def _state(self) -> Any:
        return [self._table.probabilities, self._table.scores]
