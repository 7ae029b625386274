"""Engines: the interface between the Minecraft game and the program that simulates its world.

An engine owns a world and a player in it. It turns and moves the player, tick by tick, and returns what is around the
player. It is given the goal only so that a walk stops on the tick that reaches it.
"""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from typing import ClassVar, Protocol

from smartplay_tools.errors import InvalidArgumentError, check_choice
from smartplay_tools.games.minecraft.observation import Observation, TextMode
from smartplay_tools.games.minecraft.rules import CORRECTED_GOALS, Goal, Stride
from smartplay_tools.registry import Registry


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


def try_engine(name: str) -> str:
    """Make a world on an engine; return the time that it took and the programs that made it."""
    start = time.perf_counter()
    engine = load_engine(name)(text="corrected")
    try:
        engine.reset(0, CORRECTED_GOALS[0])
        programs = "".join(f" ({program} {version})" for program, version in engine.versions.items())
    finally:
        engine.close()
    return f"a new world in {time.perf_counter() - start:.2f} s{programs}"
