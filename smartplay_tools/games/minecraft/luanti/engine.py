"""LuantiEngine: a Luanti server with the interface of an engine.

The mod in the server uses Minecraft's coordinates: +z is south, where Luanti has north, the sea ends at y = 63, and
the origin is where the player starts.
"""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, NoReturn

import numpy as np

from smartplay_tools.errors import EngineError
from smartplay_tools.games.minecraft.engines import Goal, Stride
from smartplay_tools.games.minecraft.luanti.install import find_installation
from smartplay_tools.games.minecraft.luanti.node_names import display_name
from smartplay_tools.games.minecraft.luanti.server import LuantiServer
from smartplay_tools.games.minecraft.observation import NEAR, RAY_RANGES, Observation, TextMode, heading, rays

WORLDS = 10
"""The number of worlds that are tried before an error is raised."""


@functools.cache
def _rays(yaw: float, mode: TextMode) -> list[list[float]]:
    """Direction and range of each ray."""
    listed: list[list[float]] = np.column_stack([rays(yaw, mode), RAY_RANGES]).tolist()
    return listed


class LuantiEngine:
    """A world in a Luanti server, which runs until the next reset, or until this object is closed."""

    default_text: ClassVar[TextMode] = "corrected"

    def __init__(self, *, text: TextMode) -> None:
        self._text = text
        self._installation = find_installation()
        self._server: LuantiServer | None = None

    @property
    def versions(self) -> Mapping[str, str]:
        """The version of the server."""
        return {} if self._server is None else {"luanti": self._server.version}

    def reset(self, seed: int, goal: Goal) -> Observation:
        """Start a server with the world of that seed, and put the player into it, facing south."""
        self._yaw, self._ticks = 0.0, 0
        self._made = hashlib.blake2b(digest_size=16)
        for attempt in range(WORLDS):
            self.close()
            self._seed = (seed + attempt * 0x9E3779B9) % 2**32
            self._server = LuantiServer(self._installation, self._seed)
            answer = self._ask("start", seed=self._seed, goal=sorted(goal.biomes))
            if answer["start"] is not None:
                self.way: list[tuple[int, int]] = [(x, z) for x, z in answer["way"]]
                """x and z of places on a path to the nearest goal, as seen on the map; for benchmarks."""
                return self._observe(answer["start"])
        raise EngineError(f"None of {WORLDS} worlds has {goal.name} in reach of a start; try another seed.")

    def act(self, degrees: int, strides: Sequence[Stride], goal: Goal) -> Observation:
        """Turn for one tick, then walk."""
        self._yaw = (self._yaw + degrees + 180) % 360 - 180
        sine, cosine = heading(self._yaw)
        keys = [{"left": stride.left, "jump": stride.jump} for stride in strides]
        answer = self._ask("act", sine=sine, cosine=cosine, strides=keys, goal=sorted(goal.biomes))
        self._ticks += answer["ticks"]
        return self._observe(answer["seen"])

    def state(self) -> bytes:
        """Seed, time, the player's body, the order in which the map was made, and the latest observation."""
        facts = (self._seed, self._ticks, self._yaw, self._body, self._made.hexdigest(), self._sights)
        return repr(facts).encode()

    def __reduce__(self) -> NoReturn:
        raise TypeError("A Luanti engine is a process and cannot be copied: play its actions again on a new one.")

    @property
    def position(self) -> tuple[float, float, float]:
        """The player's feet."""
        return self._body[:3]

    def close(self) -> None:
        """Stop the server and remove its folder."""
        if self._server is not None:
            self._server.close()

    def _ask(self, command: str, **arguments: Any) -> Any:
        if self._server is None:
            raise EngineError("There is no world yet: reset comes first.")
        return self._server.ask(command, rays=_rays(self._yaw, self._text), **arguments)

    def _observe(self, seen: dict[str, Any]) -> Observation:
        self._body = (*seen["position"], *seen["velocity"], seen["grounded"], seen["sprinting"])
        self._made.update(seen["made"].encode() + b";")
        self._sights = hashlib.blake2b(
            repr([seen[key] for key in ("names", "blocks", "hits", "distances")]).encode(), digest_size=16
        ).hexdigest()
        names = np.array([display_name(node, title, self._text) for node, title in seen["names"]])
        hits = np.array(seen["hits"])
        return Observation(
            position=np.array(seen["position"], np.float32),
            yaw=self._yaw,
            pitch=0.0,
            biome=seen["biome"],
            blocks=names[np.array(seen["blocks"]).reshape(NEAR, NEAR, NEAR)],
            ray_directions=np.array(_rays(self._yaw, self._text), np.float32)[:, :3],
            ray_blocks=names[hits],
            ray_block_distances=np.array(seen["distances"], np.float32),
            ray_entities=np.full(len(hits), "null"),
            ray_entity_distances=RAY_RANGES,
        )
