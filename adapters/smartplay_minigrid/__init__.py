"""MiniGrid's rooms in words: Memory in six sizes, LockedRoom, and GoToLocal of BabyAI.

The player sees a part of a grid, seven squares wide and seven deep, and has to remember what it has passed. Rules,
rewards and worlds are MiniGrid's; the words are ours. This module does not import MiniGrid; a game does.
"""

from __future__ import annotations

from smartplay_tools.games import GameSpec
from smartplay_tools.games.game_registry import Pack

__all__ = ["ROOMS"]

_MEMORY = {"S7": 245, "S9": 405, "S11": 605, "S13": 845, "S13Random": 845, "S17Random": 1445}
_STEPS = {f"MiniGrid-Memory{size}-v0": steps for size, steps in _MEMORY.items()}
_STEPS |= {"MiniGrid-LockedRoom-v0": 190, "BabyAI-GoToLocal-v0": 64}
"""The most steps of an episode, by MiniGrid's id."""

ROOMS = Pack(
    "minigrid",
    ("minigrid",),
    tuple(
        GameSpec(
            id=f"minigrid-{env.split('-', 1)[1]}",
            family="minigrid",
            entry_point="smartplay_minigrid.game:RoomGame",
            kwargs={"env": env},
            history=min(steps, 200),
            rollout=steps,
            trials=20,
            score_bounds=(0, 1),
            worst_step=0,
            action_count=7,
        )
        for env, steps in _STEPS.items()
    ),
)
"""Memory, LockedRoom and GoToLocal."""
