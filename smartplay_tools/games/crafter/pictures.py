"""Pictures of a scene, drawn by PyPI `crafter` with its own textures - from a copy, so that looking changes nothing.

At Crafter's usual size, 64, a picture is the original's to the pixel: the grain of the night is made of the numbers
that the step drew anyway. Larger pictures show larger textures under the same grain.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from crafter import constants, engine
from numpy.typing import NDArray

from smartplay_tools.games.crafter.facts import AREA, ITEMS, MATERIALS, VIEW, VITALS
from smartplay_tools.games.crafter.views import Scene

_GRID = 9
"""A picture is a square of this many textures: the view, and the inventory below."""
USUAL = 64


class _Thing(NamedTuple):
    texture: str
    pos: NDArray[np.int64]


class _Player(NamedTuple):
    pos: tuple[int, int]
    sleeping: bool


class _Grain:
    """Stands in for the world's random stream where the picture asks for the grain of the night."""

    def __init__(self, grain: NDArray[np.float64] | None) -> None:
        self._grain = grain

    def uniform(self, low: float, high: float, shape: tuple[int, int]) -> NDArray[np.float64]:
        assert self._grain is not None, "It is night, but the step has drawn no grain."
        usual = USUAL // _GRID
        grain = self._grain.reshape(VIEW[0] * usual, VIEW[1] * usual)
        columns, rows = (np.arange(size) * seen // size for size, seen in zip(shape, grain.shape, strict=True))
        enlarged: NDArray[np.float64] = low + (high - low) * grain[columns[:, None], rows]
        return enlarged


class _Stage:
    """As much of Crafter's world as its view looks at."""

    area = (AREA, AREA)

    def __init__(self, scene: Scene) -> None:
        self._ground = scene.ground
        self.objects = [_Thing(texture, np.array(at)) for texture, at in scene.things]
        self.daylight = scene.daylight
        self.random = _Grain(scene.grain)

    def __getitem__(self, at: Any) -> tuple[str, None]:
        return MATERIALS[self._ground[int(at[0]) * AREA + int(at[1])] - 1], None


@functools.cache
def _textures() -> Any:
    return engine.Textures(constants.root / "assets")


def draw(scene: Scene, size: int = USUAL) -> NDArray[np.uint8]:
    """Draw a square picture; the array is rows x columns x red, green and blue."""
    unit = np.array([size // _GRID] * 2)
    view = engine.LocalView(_Stage(scene), _textures(), list(VIEW))
    items = engine.ItemView(_textures(), [_GRID, _GRID - VIEW[1]])
    parts = view(_Player(scene.position, scene.sleeping), unit), items(_in_order(scene.inventory), unit)
    drawn = np.concatenate(parts, 1)
    canvas = np.zeros((size, size, 3), np.uint8)
    border = (size - unit[0] * _GRID) // 2
    canvas[border : border + drawn.shape[0], border : border + drawn.shape[1]] = drawn
    return canvas.transpose((1, 0, 2))


def _in_order(inventory: Mapping[str, int]) -> dict[str, int]:
    return {name: inventory[name] for name in (*VITALS, *ITEMS)}
