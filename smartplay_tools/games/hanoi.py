"""Tower of Hanoi (paper section 3.4): move a stack of disks from rod A to rod C, never a larger disk on a smaller."""

from __future__ import annotations

from typing import Any

from smartplay_tools.games.base import TextGame, read_text, with_action_list

# --- Rules -----------------------------------------------------------------------------------------------------------

Rods = tuple[tuple[int, ...], tuple[int, ...], tuple[int, ...]]
"""The disks on rods A, B and C, bottom first; disk 0 is the smallest."""

MOVES = ((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1))
"""The six actions as (source rod, target rod)."""

GOAL_REWARD = 100
ILLEGAL_REWARD = -1


def start(disks: int) -> Rods:
    """All disks on rod A."""
    return (tuple(reversed(range(disks))), (), ())


def goal(disks: int) -> Rods:
    """All disks on rod C."""
    return ((), (), tuple(reversed(range(disks))))


def is_legal(rods: Rods, source: int, target: int) -> bool:
    """Whether the top disk of `source` exists and is smaller than the top disk of `target`."""
    return bool(rods[source]) and (not rods[target] or rods[source][-1] < rods[target][-1])


def move(rods: Rods, source: int, target: int) -> Rods:
    """Return the rods after a legal move."""
    after = list(rods)
    after[source], after[target] = rods[source][:-1], (*rods[target], rods[source][-1])
    return (after[0], after[1], after[2])


def shortest(rods: Rods, target: int = 2) -> tuple[int, int] | None:
    """Return the first move of the shortest solution that gathers all disks on `target`; None if they are there.

    A disk on another rod can only move there when all smaller ones are on the third rod, so those are gathered first.
    """
    first = None
    for disk in range(sum(map(len, rods)) - 1, -1, -1):
        rod = next(rod for rod in range(3) if disk in rods[rod])
        if rod != target:
            first, target = (rod, target), 3 - rod - target
    return first


# --- Text ------------------------------------------------------------------------------------------------------------

ACTIONS = tuple(
    f"Move the top disk of rod {'ABC'[source]} to the top of rod {'ABC'[target]}" for source, target in MOVES
)


def describe(rods: Rods, action: int | None = None) -> str:
    """The observation: what was tried, if anything, and the rods."""
    tried = "" if action is None else f"You tried to {ACTIONS[action].lower()}. "
    lines = [f"- {name}: |bottom, {list(disks)}, top|" for name, disks in zip("ABC", rods, strict=True)]
    return "\n".join([f"{tried}Current configuration:", *lines])


# --- Environment -----------------------------------------------------------------------------------------------------


class Hanoi(TextGame):
    """The Tower of Hanoi.

    Action space: `Discrete(6)`, see `ACTIONS`. Observation: the move that was tried and the three rods. Reward: -1
    for an illegal move (which changes nothing), 100 for reaching the goal, else 0. Score: the disks on rod C.
    Terminates at the goal; a rollout has 30 steps.

    Arguments: `disks`, 3 or 4 in the benchmark.
    """

    actions = ACTIONS

    def __init__(self, *, disks: int, **options: Any) -> None:
        self._disks = disks
        self._rods = start(disks)
        stack = list(self._rods[0])
        self.manual = with_action_list(read_text(__package__, "hanoi.txt").format(stack=stack), ACTIONS)
        super().__init__(longest_observation=4_000 + 6 * disks, **options)

    @property
    def optimal_action(self) -> int | None:
        """The first move of the shortest solution."""
        first = shortest(self._rods)
        return None if first is None else MOVES.index(first)

    def _reset(self) -> str:
        self._rods = start(self._disks)
        return describe(self._rods)

    def _step(self, action: int) -> tuple[str, float, bool, bool]:
        source, target = MOVES[action]
        legal = is_legal(self._rods, source, target)
        if legal:
            self._rods = move(self._rods, source, target)
            self.score = len(self._rods[2])
            self.completed = self._rods == goal(self._disks)
        reward = GOAL_REWARD if self.completed else 0 if legal else ILLEGAL_REWARD
        return describe(self._rods, action), reward, self.completed, False

    def drawing(self) -> dict[str, Any]:
        """The disks on the rods, bottom first."""
        return {"rods": [list(disks) for disks in self._rods]}

    def _state(self) -> Any:
        return self._rods
