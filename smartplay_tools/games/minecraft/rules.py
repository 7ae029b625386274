"""The rules of Minecraft: the goals, and how one action of the benchmark becomes a turn and 50 ticks of walking.

Yaw is Minecraft's: degrees, 0 looks south (+z), 90 west (-x), 180 north, 270 (or -90) east.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

ACTIONS = ("Move North", "Move East", "Move South", "Move West")

TICKS = 50
"""Ticks of 50 ms that an action walks at most; it stops on the first tick in the goal biome."""

TURN_STEP = 15
"""Degrees between two bins of the camera action; a turn is rounded down to a whole bin."""


@dataclass(frozen=True)
class Goal:
    """The goal of a task. `biomes` are Minecraft's ids of the biomes that count as found."""

    name: str
    biomes: frozenset[int]


PAPER_GOALS: Mapping[int, Goal] = MappingProxyType(
    {
        # The original looks the task's words up as a substring of its biome names: "plains" is also in "Ice
        # Plains", and "ice spikes" is nowhere ("Ice Plains Spikes"), so its task 7 cannot be completed.
        0: Goal("plains", frozenset({1, 12, 129, 140})),
        1: Goal("forest", frozenset({4, 18, 27, 28, 29, 132, 155, 156, 157})),
        2: Goal("ocean", frozenset({0, 10, 24})),
        4: Goal("beach", frozenset({16, 25, 26})),
        5: Goal("taiga", frozenset({5, 19, 30, 31, 32, 33, 133, 158, 160, 161})),
        7: Goal("ice spikes", frozenset()),
        8: Goal("jungle", frozenset({21, 22, 23, 149, 151})),
        9: Goal("desert", frozenset({2, 17, 130})),
    }
)
"""Task number to goal, with the original's goal sets. The missing numbers are not in the benchmark."""

CORRECTED_GOALS: Mapping[int, Goal] = MappingProxyType({**PAPER_GOALS, 7: Goal("ice spikes", frozenset({140}))})
"""The same with a goal for task 7: the biome Ice Plains Spikes."""


@dataclass(frozen=True, slots=True)
class Stride:
    """The keys held down during one tick, beside "forward"."""

    left: int
    """1 strafes left, -1 right, 0 not at all."""
    jump: bool
    """True to jump, False to sprint."""


def turn(action: int, yaw: float) -> int:
    """Degrees to turn, clockwise from above, from `yaw` to the heading of the action: north, east, south, west."""
    bins = ((action * 90 - 180) - yaw + 180) % 360 // TURN_STEP
    return int(bins) * TURN_STEP - 180


_STRIDES = {(left, jump): Stride(left, jump) for left in (-1, 0, 1) for jump in (False, True)}


def strides(random: np.random.Generator) -> list[Stride]:
    """Draw the keys of one action's ticks.

    A strafe to either side (a quarter each) frees a walker that is stuck. The original's comment says that half of the
    ticks sprint; the other half jump.
    """
    draws = random.random((TICKS, 2)).tolist()
    return [_STRIDES[(side >= 0.75) - (0.5 <= side < 0.75), jump >= 0.5] for side, jump in draws]
