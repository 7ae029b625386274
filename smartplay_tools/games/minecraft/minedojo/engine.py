"""MineDojoEngine: MineDojo, the paper's engine, with the interface of an engine."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, NoReturn

import numpy as np

from smartplay_tools.errors import EngineError, InvalidArgumentError
from smartplay_tools.games.minecraft.minedojo import worker
from smartplay_tools.games.minecraft.minedojo.process import WorkerProcess
from smartplay_tools.games.minecraft.observation import (
    NEAR,
    RAY_OFFSETS,
    RAY_RANGES,
    Observation,
    TextMode,
    malmo_rays,
)
from smartplay_tools.games.minecraft.rules import PAPER_GOALS, TURN_STEP, Goal, Stride

INTERPRETER = "SMARTPLAY_MINEDOJO_PYTHON"
"""The variable that names the Python in which MineDojo is installed."""

LOG = "SMARTPLAY_MINEDOJO_LOG"
"""The variable that names a file for the output of MineDojo and the client; without it their log is deleted."""

START_SECONDS, CALL_SECONDS = 1_800.0, 300.0
"""Time limits of a start with a new world, which may include building the client, and of an action."""

IMAGE = (160, 256)
"""Rows and columns of the picture that the original requests but does not use."""

_TASKS = {goal.name: number for number, goal in PAPER_GOALS.items()}

_STILL = (0, 0, 0, 12, 12, 0, 0, 0)
"""MineDojo's action that does nothing: walk, strafe, jump/sneak/sprint, pitch, yaw, and three for the hands."""
_WALK, _STRAFE, _GAIT, _YAW = 0, 1, 2, 4
_JUMP, _SPRINT = 1, 3


class MineDojoEngine:
    """Minecraft, played through MineDojo in its own process.

    A start takes minutes; a new world in the same client takes less. As in the original, a start may lie in the goal,
    and the seed determines only the map: the game's own clock and random numbers cannot be controlled.

    If MineDojo fails or does not answer in time, the call raises an `EngineError` and all its processes are ended; the
    next reset starts it again.
    """

    default_text: ClassVar[TextMode] = "paper"

    def __init__(self, *, text: TextMode) -> None:
        # The client's rays and names do not depend on the text mode.
        self._worker: WorkerProcess | None = None
        self._seen: Observation | None = None
        self.versions: Mapping[str, str] = {}
        """The versions of MineDojo and gym, once they run."""

    def __reduce__(self) -> NoReturn:
        raise TypeError("A MineDojo engine is a process and cannot be copied: play its actions again on a new one.")

    def reset(self, seed: int, goal: Goal) -> Observation:
        """Make the world of that seed, in the running client or a new one."""
        self._seen = None
        if self._worker is None or not self._worker.alive:
            self._worker = start(_interpreter())
            made = {"task": _TASKS[goal.name], "settings": _settings(seed)}
            self.versions = self._worker.call("make", seconds=START_SECONDS, **made)
        try:
            # Minecraft takes a seed of 0 as no seed.
            answer = self._worker.call("reset", seconds=START_SECONDS, world_seed=str(seed or 2**32))
        except EngineError as error:
            raise EngineError(f"{error} The game's client needs Java 8; {LOG}=FILE keeps what it says.") from error
        self._seen = _observation(answer)
        return self._seen

    def act(self, degrees: int, strides: Sequence[Stride], goal: Goal) -> Observation:
        """Turn for one tick, then walk."""
        assert self._worker is not None, "reset comes before act"
        actions = [_turned(degrees), *map(_walked, strides)]
        answer = self._worker.call("act", seconds=CALL_SECONDS, actions=actions, goal=sorted(goal.biomes))
        self._seen = _observation(answer)
        return self._seen

    def state(self) -> bytes:
        """The known part of the state, which is the latest observation: the client does not reveal the rest."""
        seen = self._seen
        assert seen is not None, "reset comes before state"
        numbers = [*seen.position.tolist(), seen.yaw, seen.pitch, float(seen.biome)]
        names = [array.ravel().tolist() for array in (seen.blocks, seen.ray_blocks, seen.ray_entities)]
        return repr((numbers, names)).encode()

    def close(self) -> None:
        """End the client."""
        if self._worker is not None:
            self._worker.close()
            self._worker = None


def start(python: str) -> WorkerProcess:
    """Start a worker in the interpreter of that path."""
    # -I: no module of this process or of the working directory may shadow one of MineDojo's.
    command = [python, "-I", str(Path(worker.__file__))]
    log = os.environ.get(LOG)
    # MineDojo then prints the client's output, so that the log says why a client does not start.
    verbose = os.environ.get("MINEDOJO_DEBUG_LOG", "1")
    return WorkerProcess(command, log=Path(log).absolute() if log else None, MINEDOJO_DEBUG_LOG=verbose)


def _interpreter() -> str:
    python = os.environ.get(INTERPRETER)
    if not python:
        raise InvalidArgumentError(
            "The engine minedojo needs a separate environment, which three commands in docs/minecraft.md make, and "
            f"{INTERPRETER} has to name its Python."
        )
    return python


def _settings(seed: int) -> dict[str, Any]:
    """The arguments with which the original makes its environment; the seed is for the client's own generator."""
    reach = NEAR // 2
    rays = [(pitch, yaw, limit) for (pitch, yaw), limit in zip(RAY_OFFSETS.tolist(), RAY_RANGES.tolist(), strict=True)]
    return {
        "image_size": IMAGE,
        "fast_reset": False,
        "use_voxel": True,
        "voxel_size": {f"{axis}{end}": side for axis in "xyz" for end, side in (("min", -reach), ("max", reach))},
        "use_lidar": True,
        "lidar_rays": rays,
        "seed": seed,
    }


def _turned(degrees: int) -> list[int]:
    action = list(_STILL)
    action[_YAW] += degrees // TURN_STEP
    return action


def _walked(stride: Stride) -> list[int]:
    action = list(_STILL)
    action[_WALK] = 1
    action[_STRAFE] = {0: 0, 1: 1, -1: 2}[stride.left]
    action[_GAIT] = _JUMP if stride.jump else _SPRINT
    return action


def _observation(answer: dict[str, Any]) -> Observation:
    rays = answer["rays"]
    return Observation(
        position=np.array(answer["position"], np.float32),
        yaw=answer["yaw"],
        pitch=answer["pitch"],
        biome=answer["biome"],
        blocks=np.array(answer["blocks"]),
        # The client casts these rays in both text modes.
        ray_directions=malmo_rays(answer["yaw"], answer["pitch"]),
        ray_blocks=np.array(rays["block_name"]),
        ray_block_distances=np.array(rays["block_distance"], np.float32),
        ray_entities=np.array(rays["entity_name"]),
        ray_entity_distances=np.array(rays["entity_distance"], np.float32),
    )
