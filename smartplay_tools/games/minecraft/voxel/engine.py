"""VoxelEngine: the embedded world with the interface of an engine."""

from __future__ import annotations

import functools
import math
import struct
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from smartplay_tools.games.minecraft.observation import (
    NEAR,
    RAY_RANGES,
    Observation,
    TextMode,
    heading,
    rays,
)
from smartplay_tools.games.minecraft.rules import Goal, Stride
from smartplay_tools.games.minecraft.voxel import animals, blocks
from smartplay_tools.games.minecraft.voxel.rays import Fan, hit_boxes
from smartplay_tools.games.minecraft.voxel.start import make_world
from smartplay_tools.games.minecraft.voxel.walking import EYES, Walker


@functools.cache
def _fan(yaw: float, mode: TextMode) -> Fan:
    return Fan(rays(yaw, mode), RAY_RANGES)


class VoxelEngine:
    """A world of blocks in this process; it needs nothing but NumPy."""

    default_text: ClassVar[TextMode] = "corrected"

    versions: Mapping[str, str] = MappingProxyType({})
    """Empty: the engine is part of this package."""

    def __init__(self, *, text: TextMode) -> None:
        self._text = text

    def reset(self, seed: int, goal: Goal) -> Observation:
        """Make the world of that seed and put the player into it, facing south."""
        self.world, feet = make_world(seed, goal.biomes)
        self._player = Walker(self.world, *feet)
        self._yaw, self._time = 0.0, 0
        return self._observe()

    def act(self, degrees: int, strides: Sequence[Stride], goal: Goal) -> Observation:
        """Turn for one tick, then walk."""
        player = self._player
        self._yaw = (self._yaw + degrees + 180) % 360 - 180
        sine, cosine = heading(self._yaw)
        player.tick(None, sine, cosine)
        self._time += 1
        column = None
        for stride in strides:
            player.tick(stride, sine, cosine)
            self._time += 1
            if column != (column := (math.floor(player.x), math.floor(player.z))) and self._biome() in goal.biomes:
                break
        return self._observe()

    def state(self) -> bytes:
        """Seed, time and the player's body; everything else follows from them."""
        p = self._player
        return struct.pack(
            "<qq7d??", self.world.seed, self._time, p.x, p.y, p.z, p.vx, p.vy, p.vz, self._yaw, p.grounded, p.sprinting
        )

    def close(self) -> None:
        """Do nothing: the engine holds only memory."""

    @property
    def position(self) -> tuple[float, float, float]:
        """The player's feet."""
        return self._player.x, self._player.y, self._player.z

    def _biome(self) -> int:
        return self.world.biome_at(math.floor(self._player.x), math.floor(self._player.z))

    def _observe(self) -> Observation:
        p = self._player
        x, y, z = math.floor(p.x), math.floor(p.y), math.floor(p.z)
        self.world.prepare(x, z)
        names = blocks.NAMES[self._text]
        fan, eye = _fan(self._yaw, self._text), (p.x, p.y + EYES, p.z)
        hits, block_distances = fan.hit_blocks(self.world.blocks, eye)
        species, low, high = animals.animals_near(self.world, x, z, self._time)
        hit, entity_distances = hit_boxes(low, high, eye, fan.directions, block_distances)
        return Observation(
            position=np.array([p.x, p.y, p.z], np.float32),
            yaw=self._yaw,
            pitch=0.0,
            biome=self._biome(),
            blocks=names[self.world.cube(x, y, z, NEAR // 2)],
            ray_directions=fan.directions,
            ray_blocks=names[hits],
            ray_block_distances=block_distances,
            ray_entities=animals.NAMES[np.append(species + 1, 0)[hit]],
            ray_entity_distances=entity_distances,
        )
