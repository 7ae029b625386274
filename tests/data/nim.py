"""A game in a file: take matches, and the last one wins."""

import smartplay_tools as sp
from smartplay_tools.games import with_action_list

ACTIONS = ("Take 1", "Take 2", "Take 3")


class Nim(sp.TextGame):
    """Take one to three matches. Score: whether the last one was taken."""

    actions = ACTIONS
    manual = with_action_list("Take the last match.", ACTIONS)

    def _reset(self):
        self.left = 10 + int(self.np_random.integers(10))
        return f"{self.left} matches."

    def _step(self, action):
        self.left = max(0, self.left - action - 1)
        self.completed = self.left == 0
        self.score = int(self.completed)
        return f"{self.left} matches.", self.score, self.completed, False

    def _state(self):
        return self.left


SPEC = sp.GameSpec(id="Nim-v0", family="nim", entry_point=Nim, history=5, rollout=30, trials=3, score_bounds=(0, 1))
