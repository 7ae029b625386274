"""Lockers: a player is told which item lies in which locker, and is asked for each of them later.

It is a game of memory that a small model can play: a turn is one short sentence, and an action is one word. How much
has to be remembered, for how long and among what else are its dials.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import gymnasium
from gymnasium import spaces

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.games.gymnasium_game import GymnasiumGame

ITEMS = ("lantern", "rope", "map", "coin", "bell", "mirror", "candle", "compass")
NOTED = "noted"
"""The action where nothing is asked."""
COLORS = ("green", "red", "blue", "white", "black", "yellow")
MOST = 1_000
"""The most lockers, and the most steps of each other kind."""
TOLD = re.compile(r"Locker (\d+) (?:now )?holds the (\w+)\.")
ASKED = re.compile(r"Which item is in locker (\d+)\?")

Order = Literal["free", "told", "reversed"]


@dataclass(frozen=True)
class Turn:
    """What the player reads at a step, and what its next action should be."""

    text: str
    right: str = NOTED
    locker: int | None = None
    """The locker that is told or asked about; None where neither is done."""


class LockersEnv(gymnasium.Env[Any, Any]):
    """The environment: turns that are drawn at a reset. Its observation is the number of the turn."""

    def __init__(self, *, facts: int, distractors: int, distance: int, updates: int, order: Order) -> None:
        self.facts, self.distractors, self.distance, self.updates, self.order = (
            facts, distractors, distance, updates, order
        )  # fmt: skip
        self.action_space = spaces.Discrete(len(ITEMS) + 1)
        self.observation_space = spaces.Discrete(2 * facts + distractors + distance + updates + 1)
        self.turns: list[Turn] = []
        self.at = 0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[int, dict[str, Any]]:
        """Draw the turns of a world."""
        super().reset(seed=seed, options=options)
        told, held = self._told()
        asked = list(held)[:: -1 if self.order == "reversed" else 1]
        if self.order == "free":
            self.np_random.shuffle(asked)
        questions = [Turn(f"Which item is in locker {locker}?", held[locker], locker) for locker in asked]
        waits = [Turn("A clock ticks.")] * self.distance
        self.turns, self.at = [*told, *waits, *questions, Turn("That was the last question.")], 0
        return 0, {}

    def step(self, action: int) -> tuple[int, float, bool, bool, dict[str, Any]]:
        """Answer a turn; a right item is worth a point."""
        turn = self.turns[self.at]
        is_right = turn.right != NOTED and action < len(ITEMS) and ITEMS[action] == turn.right
        self.at += 1
        return self.at, float(is_right), self.at == len(self.turns) - 1, False, {}

    def _told(self) -> tuple[list[Turn], dict[int, str]]:
        """Return the turns that tell something, and what each locker holds in the end, in the order of the telling."""
        lockers = range(1, self.facts + 1)
        changed = self.np_random.choice(lockers, self.updates)
        told, held = list[Turn](), dict[int, str]()
        for locker in map(int, self.np_random.permutation([*lockers, *changed, *[0] * self.distractors])):
            if locker:
                verb = "now holds" if locker in held else "holds"
                held[locker] = self._another_than(held.get(locker))
                told.append(Turn(f"Locker {locker} {verb} the {held[locker]}.", locker=locker))
            else:
                color, other = self.np_random.choice(COLORS), self.np_random.choice(lockers)
                told.append(Turn(f"Locker {other} is painted {color}."))
        return told, held

    def _another_than(self, item: str | None) -> str:
        return str(self.np_random.choice([each for each in ITEMS if each != item]))


class Lockers(GymnasiumGame):
    """Be told which item lies in which locker, and be asked for each later. The score counts the right answers."""

    uses_global_streams = False
    actions = (*ITEMS, NOTED)

    def __init__(
        self,
        *,
        facts: int = 6,
        distractors: int = 0,
        distance: int = 0,
        updates: int = 0,
        order: Order = "free",
        **options: Any,
    ) -> None:
        """The dials.

        Arguments:
            facts: how many lockers there are, each of which is told and asked about.
            distractors: how many sentences about lockers, of no use for any question, stand among those that are told.
            distance: how many turns lie between the last thing told and the first question.
            updates: how many times a locker that was told gets another item, and the player is told so.
            order: in which order the lockers are asked for: "free" is at random, "told" and "reversed" are as told.
            options: those of `TextGame`.
        """
        self.dials = {"facts": facts, "distractors": distractors, "distance": distance, "updates": updates}
        for name, count in self.dials.items():
            least = int(name == "facts")
            if type(count) is not int or not least <= count <= MOST:
                raise InvalidArgumentError(f"{name} is a whole number from {least} to {MOST:,}, not {count!r}.")
        if order not in ("free", "told", "reversed"):
            raise InvalidArgumentError(f"order is free, told or reversed, not {order!r}.")
        self.order = order
        manual = (
            f"There are {facts} lockers. First you are told, one sentence at a time, what they hold: play {NOTED}. "
            "What a locker holds can change, and then the newest sentence about it counts. Later you are asked for the "
            "item in each locker, once: play the name of the item. Every right item adds one point to your score."
        )
        super().__init__(manual=manual, **options)

    def make_env(self) -> LockersEnv:
        """The environment with these dials."""
        return LockersEnv(**self.dials, order=self.order)

    def describe(self, observation: int, info: Mapping[str, Any]) -> str:
        """The sentence of the turn."""
        return self._turns[observation].text

    def _step(self, action: int) -> tuple[str, float, bool, bool]:
        played = super()._step(action)
        self.completed = self.score == self.dials["facts"]
        return played

    @property
    def _turns(self) -> list[Turn]:
        return self.env.unwrapped.turns  # type: ignore[attr-defined, no-any-return]  # it is a `LockersEnv`

    @property
    def optimal_action(self) -> int | None:
        """The item that is asked for, or that something was noted."""
        return self.actions.index(self._turns[self.env_observation].right)

    @property
    def needs(self) -> Mapping[int, str]:
        """The step that told last what the locker holds that is asked for, and what it told."""
        turn = self._turns[self.env_observation]
        if turn.right == NOTED:
            return {}
        step = max(at for at, each in enumerate(self._turns) if each.locker == turn.locker and each.right == NOTED)
        return {step: f"{turn.locker} {turn.right}"}

    @classmethod
    def right_actions(cls, seen: Mapping[int, str], actions: Sequence[str]) -> Sequence[str]:
        """The newest item that was told of the locker that is asked for; where nothing is asked, that it was noted."""
        question = ASKED.search(seen[max(seen)])
        if question is None:
            return (NOTED,)
        told = [found for step in sorted(seen) for found in TOLD.findall(seen[step])]
        return next(((item,) for locker, item in reversed(told) if locker == question[1]), ())
