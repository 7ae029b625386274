"""A game whose observations have few words, often, and are of all lengths, so that every part of a score decides."""

from __future__ import annotations

from typing import Any

import smartplay_tools as sp
from smartplay_tools.games import with_action_list

ACTIONS = ("Go on", "Stay.")
VOCABULARY = ("red", "green", "blue", "ape", "bee", "cat", "dog", "one", "two", "three")
LONGEST = 30


class Babble(sp.TextGame):
    """Says words at random. Reward and score: none."""

    actions = ACTIONS
    manual = with_action_list("Listen.", ACTIONS)

    def __init__(self, **options: Any) -> None:
        longest = LONGEST * (max(map(len, VOCABULARY)) + 1)
        super().__init__(longest_observation=longest, characters="".join(VOCABULARY) + " ", **options)

    def _reset(self) -> str:
        return self._say()

    def _step(self, action: int) -> tuple[str, float, bool, bool]:
        return self._say(), 0.0, False, False

    def _state(self) -> Any:
        return None

    def _say(self) -> str:
        count = int(self.np_random.integers(1, LONGEST + 1))
        return " ".join(VOCABULARY[int(number)] for number in self.np_random.integers(len(VOCABULARY), size=count))


BABBLE = sp.GameSpec(id="Babble-v0", family="babble", entry_point=Babble, history=4, rollout=60, trials=1)
