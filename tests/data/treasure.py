"""A game around a Gymnasium environment: find the treasure on a line, which moves when a bell rings."""

import gymnasium
from gymnasium import spaces

import smartplay_tools as sp
from smartplay_tools.games import GymnasiumGame

SQUARES = 5


class Treasure(gymnasium.Env):
    """Walk left and right and dig; a dig costs 1, and the right one ends it with 5."""

    action_space = spaces.Discrete(3)
    observation_space = spaces.MultiDiscrete([SQUARES, 2])

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.place, self.bell = 0, False
        self.treasure = int(self.np_random.integers(1, SQUARES))
        return self.seen(), {"place": self.place}

    def step(self, action):
        found = action == 2 and self.place == self.treasure
        self.place = min(max(self.place + (-1, 1, 0)[action], 0), SQUARES - 1)
        self.bell = bool(self.np_random.random() < 0.1)
        if self.bell:
            self.treasure = int(self.np_random.integers(1, SQUARES))
        reward = 5.0 if found else -1.0 if action == 2 else 0.0
        return self.seen(), reward, found, False, {"place": self.place}

    def seen(self):
        return self.place, int(self.bell)


class TreasureGame(GymnasiumGame):
    """The line in words."""

    actions = ("Go left", "Go right", "Dig")
    manual = "Find the treasure. It moves when the bell rings. A dig that finds nothing costs a point."

    def make_env(self):
        return Treasure()

    def describe(self, observation, info):
        place, bell = observation
        return f"You are on square {place}.{' The bell rings.' if bell else ''}"

    @property
    def needs(self):
        return [self._steps]

    @property
    def breaks(self):
        return [0] if self.env.place == 0 else []

    def drawing(self):
        return {"text": "".join("x" if square == self.env.treasure else "." for square in range(SQUARES))}


SPEC = sp.GameSpec(
    id="Treasure-v0",
    family="treasure",
    entry_point=TreasureGame,
    history=5,
    rollout=30,
    trials=3,
    score_bounds=(-30, 5),
    memory=0,
    worst_step=-1,
    action_count=3,
)
