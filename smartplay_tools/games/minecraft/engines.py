"""Engines: the interface between the Minecraft game and the program that simulates its world, and its rules.

An engine owns a world and a player in it. It turns and moves the player, tick by tick, and returns what is around the
player. It is given the goal only so that a walk stops on the tick that reaches it. `check_engines` says which engines
work on this machine, by creating a world on each of them.

The rules are the goals, and how one action of the benchmark becomes a turn and 50 ticks of walking. Yaw is Minecraft's:
degrees, 0 looks south (+z), 90 west (-x), 180 north, 270 (or -90) east.
"""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar, Protocol

import numpy as np

from smartplay_tools.errors import InvalidArgumentError, SmartPlayError, check_choice
from smartplay_tools.games.minecraft.observation import Observation, TextMode
from smartplay_tools.registry import Registry

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


class Engine(Protocol):
    """A world with a player in it."""

    default_text: ClassVar[TextMode]
    """The default text mode of this engine."""

    def __init__(self, *, text: TextMode) -> None: ...

    @property
    def versions(self) -> Mapping[str, str]:
        """Name to version of the programs that play, apart from this package, for the result."""
        ...

    def reset(self, seed: int, goal: Goal) -> Observation:
        """Make the world of that seed and put the player into it.

        An engine that can choose the start keeps it away from the goal's biomes; without any, it begins anywhere.
        """
        ...

    def act(self, degrees: int, strides: Sequence[Stride], goal: Goal) -> Observation:
        """Turn for one tick, then walk a tick for each stride, and stop after a tick that ends in a goal biome."""
        ...

    def state(self) -> bytes:
        """The whole state on which the future depends, apart from the player's actions."""
        ...

    def close(self) -> None:
        """Release the engine's resources; may be called more than once."""
        ...


ENGINES = Registry(
    "engine",
    {
        "voxel": "smartplay_tools.games.minecraft.voxel.engine:VoxelEngine",
        "minedojo": "smartplay_tools.games.minecraft.minedojo.engine:MineDojoEngine",
    },
)
"""Name to class, imported when a game needs it."""

UNIX_ONLY = frozenset({"minedojo"})
"""Engines that run as separate processes, connected by pipes."""

FORMER = frozenset({"luanti"})
"""Engines of earlier versions, which records may name."""


def load_engine(name: str) -> type[Engine]:
    """Return the engine's class; raise `InvalidArgumentError` if it cannot run on this system."""
    if name in FORMER:
        raise InvalidArgumentError(
            f"This version has no engine {name!r}, so nothing can be played on it again; its records are still read "
            f"and reported. The engines are {', '.join(ENGINES)}."
        )
    check_choice("engine", name, ENGINES)
    if name in UNIX_ONLY and not hasattr(os, "killpg"):
        raise InvalidArgumentError(
            f"The engine {name!r} needs the processes and pipes of Unix; use the engine 'voxel' here, or WSL."
        )
    engine: type[Engine] = ENGINES[name]
    return engine


@dataclass(frozen=True)
class Check:
    """The result of the check of an engine."""

    engine: str
    works: bool
    detail: str
    """The time that a new world took and the program that made it, or the error and the remedy."""


def check_engines() -> list[Check]:
    """Make a world on every engine; if one fails, the others are still tried."""
    return [_check(name) for name in ENGINES]


def _check(name: str) -> Check:
    start = time.perf_counter()
    try:
        engine = load_engine(name)(text="corrected")
        try:
            engine.reset(0, CORRECTED_GOALS[0])
            programs = "".join(f" ({program} {version})" for program, version in engine.versions.items())
        finally:
            engine.close()
    except SmartPlayError as error:
        return Check(name, False, str(error))
    except Exception as error:  # any error of an engine is a result of the check
        return Check(name, False, f"{type(error).__name__}: {error}")
    return Check(name, True, f"a new world in {time.perf_counter() - start:.2f} s{programs}")
