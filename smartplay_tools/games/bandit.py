"""Two-armed bandit (paper section 3.2): fifty pulls to find and use the better of two slot machines."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from numpy.random import Generator

from smartplay_tools.games.base import TextGame, read_text, with_action_list

# --- Rules -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Arm:
    """A slot machine: a pull pays `reward` with `probability`, and otherwise costs the same amount."""

    probability: float
    reward: int

    @property
    def expected_reward(self) -> float:
        """The mean reward of a pull."""
        return (2 * self.probability - 1) * self.reward


def shuffle(arms: tuple[Arm, Arm], chance: Generator) -> tuple[Arm, Arm]:
    """Put the arms in random order, so that the number of an action says nothing about its quality."""
    first, second = arms
    return (first, second) if chance.random() < 0.5 else (second, first)


def pull(arm: Arm, chance: Generator) -> int:
    """Return the reward of one pull."""
    return arm.reward if chance.random() < arm.probability else -arm.reward


def best(arms: tuple[Arm, Arm]) -> int:
    """Return the index of the arm with the larger expected reward, the optimal action of every step."""
    return max(range(2), key=lambda index: arms[index].expected_reward)


# --- Text ------------------------------------------------------------------------------------------------------------

ACTIONS = ("Pull slot machine 1.", "Pull slot machine 2.")
START = "A new round begins."


def describe(action: int, reward: int) -> str:
    """The observation after a pull."""
    return f"You pulled slot machine {action + 1}, you received reward {reward}."


# --- Environment -----------------------------------------------------------------------------------------------------


class Bandit(TextGame):
    """Two slot machines with unknown odds.

    Action space: `Discrete(2)`, pull machine 1 or 2. Observation: the pull and its reward. Reward: +r or -r.
    Score: the number of pulls of the better machine. The game never ends by itself; a rollout has 50 steps.

    Arguments: `arms`, the (probability, reward) of both machines, put in random order at every reset.
    """

    actions = ACTIONS

    def __init__(self, *, arms: tuple[tuple[float, int], tuple[float, int]], **options: Any) -> None:
        (p1, r1), (p2, r2) = arms
        self._arms = (Arm(p1, r1), Arm(p2, r2))
        self.manual = with_action_list(read_text(__package__, "bandit.txt"), ACTIONS)
        super().__init__(**options)

    @property
    def optimal_action(self) -> int:
        """The machine with the larger expected reward."""
        return self._best

    def _reset(self) -> str:
        self._order = shuffle(self._arms, self.np_random)
        self._best = best(self._order)
        return START

    def _step(self, action: int) -> tuple[str, float, bool, bool]:
        reward = pull(self._order[action], self.np_random)
        self.score += action == self._best
        return describe(action, reward), reward, False, False

    def drawing(self) -> dict[str, Any]:
        """The machines as they really are, (probability, reward), and the better one."""
        return {"arms": [[arm.probability, arm.reward] for arm in self._order], "best": self._best}

    def _state(self) -> Any:
        return [[arm.probability, arm.reward] for arm in self._order]
