"""The data that an engine returns after an action, and the rays of the view.

Coordinates are Minecraft's (+x east, +y up, +z south) whatever the engine uses inside.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

TextMode = Literal["paper", "corrected"]
"""`paper` is the original's output with its bugs; `corrected` has true directions and a goal for every task."""

NEAR = 9
"""The cube of blocks around the feet has 9 blocks a side."""

VIEW = 17
"""The view is a grid of 17 x 17 rays."""

VIEW_STEP = 6
"""Degrees between two rays of the view, which spans 96 degrees each way."""

CURSOR_RANGE, VIEW_RANGE = 3.0, 65.0

_OFFSETS = [math.radians(VIEW_STEP * (i - VIEW // 2)) for i in range(VIEW)]
RAY_OFFSETS = np.array([(0.0, 0.0), *((pitch, yaw) for pitch in _OFFSETS for yaw in _OFFSETS)])
"""(pitch, yaw) of the cursor and then of the view's rays, in radians, row by row."""

RAY_RANGES = np.array([CURSOR_RANGE] + [VIEW_RANGE] * VIEW * VIEW, np.float32)


_DISPLAYED = {
    "podzol": "dirt",
    "snowy grass block": "grass block",
    "snow block": "snow",
    "tall grass": "grass",
    "fern": "grass",
    **dict.fromkeys(("mushroom block", "brown mushroom", "red mushroom"), "mushroom"),
    **dict.fromkeys(("dandelion", "oxeye daisy", "poppy", "orange tulip", "black tulip"), "flower"),
    **dict.fromkeys(("allium", "blue orchid", "green chrysanthemum"), "flower"),
}


def displayed(kind: str) -> str:
    """The name of a kind of block as the original shows it, which ignores the variety: every tree is "wood"."""
    return _DISPLAYED.get(kind) or next((word for word in ("wood", "leaves") if kind.endswith(f" {word}")), kind)


@dataclass(frozen=True)
class Observation:
    """The world around the player. Names are the game's display names in lower case."""

    position: NDArray[np.float32]
    """x, y, z of the feet."""
    yaw: float
    pitch: float
    biome: int
    """Minecraft's id of the biome at the feet."""
    blocks: NDArray[Any]
    """Block names by [x, y, z], ascending, the feet in the middle of the 9 x 9 x 9."""
    ray_directions: NDArray[np.float32]
    """Unit vectors of the 290 rays."""
    ray_blocks: NDArray[Any]
    """The block that each ray hits; "air" for none."""
    ray_block_distances: NDArray[np.float32]
    ray_entities: NDArray[Any]
    """The entity that each ray hits; "null" for none."""
    ray_entity_distances: NDArray[np.float32]


def heading(yaw: float) -> tuple[float, float]:
    """Sine and cosine of a yaw, exact for the four main headings: walking must not depend on a machine's sine."""
    angle = math.radians(yaw)
    return round(math.sin(angle), 12), round(math.cos(angle), 12)


def malmo_rays(yaw: float, pitch: float = 0.0) -> NDArray[np.float32]:
    """The original's rays: pitched about the WORLD's x axis, then turned.

    That is right for a player who faces south, upside down for one who faces north; facing east or west, all rows are
    the same. Positive angles turn left and up.
    """
    sine, cosine = heading(yaw)
    level = math.cos(math.radians(pitch))
    look_x, look_y, look_z = -sine * level, -math.sin(math.radians(pitch)), cosine * level
    pitch_sine, pitch_cosine = np.sin(RAY_OFFSETS[:, 0]), np.cos(RAY_OFFSETS[:, 0])
    yaw_sine, yaw_cosine = np.sin(RAY_OFFSETS[:, 1]), np.cos(RAY_OFFSETS[:, 1])
    y = look_y * pitch_cosine + look_z * pitch_sine
    z = look_z * pitch_cosine - look_y * pitch_sine
    rays = np.stack([look_x * yaw_cosine + z * yaw_sine, y, z * yaw_cosine - look_x * yaw_sine], axis=1)
    return rays.astype(np.float32)


def true_rays(yaw: float) -> NDArray[np.float32]:
    """The rays as the original intended: those of a player who faces south, turned with the player."""
    south = malmo_rays(0).astype(np.float64)
    sine, cosine = heading(yaw)
    x, y, z = south.T
    return np.stack([x * cosine - z * sine, y, x * sine + z * cosine], axis=1).astype(np.float32)


def rays(yaw: float, mode: TextMode) -> NDArray[np.float32]:
    """The rays of a player who looks level, in the mode's geometry."""
    return malmo_rays(yaw) if mode == "paper" else true_rays(yaw)
