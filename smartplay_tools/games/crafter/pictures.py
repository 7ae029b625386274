"""Pictures of a scene, equal to those of PyPI `crafter` to the pixel, from a copy: looking changes nothing.

The textures are the image files of PyPI `crafter`, scaled and laid over each other with its arithmetic: nearest pixels,
blending in single precision. Only the files are read; the package is not imported. Every cell that can be seen is
computed once and then looked up.

At Crafter's usual size, 64, the noise of the night is made of the numbers that the step has drawn. Larger pictures
show larger textures under the same grain. Every sum is rounded where the original and its imaging library round it.
"""

from __future__ import annotations

import functools
import importlib.util
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from smartplay_tools.games.crafter.facts import CARRIED, MATERIALS, MOST, VIEW
from smartplay_tools.games.crafter.views import Scene

Pixels = NDArray[np.uint8]

NO_TEXTURE = "none"
BODIES = (
    *("player-left", "player-right", "player-up", "player-down", "player-sleep"),
    *("cow", "zombie", "skeleton"),
    *("arrow-left", "arrow-right", "arrow-up", "arrow-down"),
    *("plant", "plant-ripe"),
)
"""The textures of things, and of the player."""
LAYERS = (NO_TEXTURE, *BODIES)
"""The things that can be on the ground of a cell, by number."""
OUTSIDE = 127
"""The grey of a cell beyond the map, as red, green and blue."""


class Tiles(NamedTuple):
    """The pictures of cells. Each is planes of red, green and blue, of rows, of columns."""

    cells: Pixels
    """By material (0: beyond the map) and layer."""
    carried: Pixels
    """By vital or item and amount."""


@functools.cache
def tiles(unit: int) -> Tiles:
    """The pictures of cells that are `unit` pixels wide and high."""
    cells = np.empty((len(MATERIALS) + 1, len(LAYERS), 3, unit, unit), np.uint8)
    for number, material in enumerate((None, *MATERIALS)):
        ground = np.full((unit, unit, 3), OUTSIDE, np.uint8) if material is None else _scaled(material, unit)[..., :3]
        cells[number] = ground.transpose(2, 0, 1)
        for layer, body in enumerate(BODIES, start=1):
            cells[number, layer] = _laid_over(ground, _scaled(body, unit), 0).transpose(2, 0, 1)
    carried = np.zeros((len(CARRIED), MOST + 1, 3, unit, unit), np.uint8)
    for number, item in enumerate(CARRIED):
        for amount in range(1, MOST + 1):
            # An item fills four fifths of its cell, and the amount three fifths, further to the right and below.
            picture = _laid_over(np.zeros((unit, unit, 3), np.uint8), _scaled(item, 0.8 * unit), int(0.1 * unit))
            picture = _laid_over(picture, _scaled(str(amount), 0.6 * unit), int(0.4 * unit))
            carried[number, amount] = picture.transpose(2, 0, 1)
    return Tiles(cells, carried)


def _folder() -> Path:
    spec = importlib.util.find_spec("crafter")
    assert spec is not None, "crafter is a dependency of this package."
    assert spec.submodule_search_locations is not None
    return Path(spec.submodule_search_locations[0], "assets")


def _scaled(name: str, side: float) -> Pixels:
    """A texture, rows by columns by red, green, blue and, where it has holes, opacity."""
    # Only pictures need the imaging library.
    from PIL import Image

    with Image.open(_folder() / f"{name}.png") as image:
        return np.array(image.resize((int(side), int(side)), resample=Image.Resampling.NEAREST))


def _laid_over(ground: Pixels, texture: Pixels, offset: int) -> Pixels:
    """A texture laid over a picture, `offset` pixels from its top and its left."""
    side = texture.shape[0]
    picture = ground.copy()
    under = picture[offset : offset + side, offset : offset + side]
    if texture.shape[-1] == 4:
        opacity = texture[..., 3:].astype(np.float32) / 255
        colour = texture[..., :3].astype(np.float32) / 255
        blended = opacity * colour + (1 - opacity) * (under.astype(np.float32) / 255)
        under[:] = (255 * blended).astype(np.uint8)
    else:
        under[:] = texture
    return picture


@functools.cache
def vignette(columns: int, rows: int) -> NDArray[np.float64]:
    """The strength of the night's noise at each pixel of the view: rows by columns, weakest in the middle."""
    across, down = np.meshgrid(np.linspace(-1, 1, columns), np.linspace(-1, 1, rows))
    strength: NDArray[np.float64] = 1 - np.exp(-0.5 * (across**2 + down**2) / (0.5**2))
    return strength


GRID = 9
"""A picture is a square of this many cells: the view, and the inventory below."""
USUAL = 64
UNIT = USUAL // GRID
"""The width of a cell in a picture of the usual size."""

LUMA = (19595, 38470, 7471)
"""The shares of red, green and blue in brightness, of 65,536."""
SATURATION = np.float32(0.4)
"""The share of its colours that a picture keeps at night."""
NIGHT, SLEEP = (0, 16, 64), (0, 0, 16)
"""The colours that are mixed in, half and half, at night and in sleep."""
DARKEST_GRAIN, BRIGHTEST_GRAIN = 32, 127

Planes = NDArray[np.uint8]
"""Red, green and blue, each rows by columns."""


def draw(scene: Scene, size: int = USUAL) -> Pixels:
    """Draw a square picture; the array is rows x columns x red, green and blue."""
    unit, (columns, rows) = size // GRID, VIEW
    cells, carried = tiles(unit)
    seen = lit(_joined(cells[cells_seen(scene)]), scene)
    view = asleep(seen) if scene.sleeping else seen.astype(np.uint8)
    below = np.zeros((GRID * (GRID - rows), 3, unit, unit), np.uint8)
    for number, name in enumerate(CARRIED):
        below[number] = carried[number, scene.inventory[name]]
    amounts = _joined(below.reshape(GRID - rows, columns, 3, unit, unit))
    border = (size - unit * GRID) // 2
    inside = slice(border, border + unit * GRID)
    picture = np.zeros((size, size, 3), np.uint8)
    picture[inside, inside] = np.concatenate((view, amounts), axis=1).transpose(1, 2, 0)
    return picture


def cells_seen(scene: Scene) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Materials (0: outside the map) and the things on them (by their number in `LAYERS`), by row and column."""
    materials = np.frombuffer(scene.ground, np.uint8).reshape(VIEW).T
    layers = np.zeros_like(materials)
    for texture, column, row in scene.things:
        layers[row, column] = LAYERS.index(texture)
    return materials, layers


def _joined(cells: NDArray[np.uint8]) -> Planes:
    """The planes of the picture that cells make, which are given by row and column."""
    rows, columns, _, unit, _ = cells.shape
    return cells.transpose(2, 0, 3, 1, 4).reshape(3, rows * unit, columns * unit)


def lit(planes: Planes, scene: Scene) -> NDArray[np.float64]:
    """The view with the light of its time of day."""
    daylight = scene.daylight
    dark = _with_grain(planes, 2 * (0.5 - daylight), scene.grain) if daylight < 0.5 else planes
    seen: NDArray[np.float64] = daylight * planes + (1 - daylight) * _tinted(_faded(dark), NIGHT)
    return seen


def _faded(planes: Planes) -> Planes:
    """The planes with the share of their colours that the night leaves."""
    grey = _brightness(planes)
    return (grey + SATURATION * (planes.astype(np.int32) - grey).astype(np.float32)).astype(np.float32).astype(np.uint8)


def _with_grain(planes: Planes, amount: float, grain: NDArray[np.float64] | None) -> Planes:
    assert grain is not None, "It is night, but the step has drawn no grain."
    usual = grain.reshape(VIEW[0] * UNIT, VIEW[1] * UNIT).T
    rows, columns = (np.arange(size) * seen // size for size, seen in zip(planes.shape[1:], usual.shape, strict=True))
    noise = DARKEST_GRAIN + (BRIGHTEST_GRAIN - DARKEST_GRAIN) * usual[rows[:, None], columns]
    strength = amount * vignette(planes.shape[2], planes.shape[1])
    grainy: Planes = ((1 - strength) * planes + strength * noise).astype(np.uint8)
    return grainy


def asleep(seen: NDArray[np.float64]) -> Planes:
    """The view in the colours of sleep."""
    return _tinted(_brightness(seen.astype(np.uint8))[None], SLEEP).astype(np.uint8)


def _brightness(planes: Planes) -> NDArray[np.int32]:
    red, green, blue = planes.astype(np.int32)
    bright: NDArray[np.int32] = (red * LUMA[0] + green * LUMA[1] + blue * LUMA[2] + 0x8000) >> 16
    return bright


def _tinted(planes: NDArray[np.integer], colour: tuple[int, int, int]) -> NDArray[np.float64]:
    tinted: NDArray[np.float64] = 0.5 * planes + 0.5 * np.array(colour)[:, None, None]
    return tinted
