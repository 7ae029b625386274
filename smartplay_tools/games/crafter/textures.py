"""The pictures of single cells in every combination that can be seen, computed once and then looked up.

The textures are the image files of PyPI `crafter`, scaled and laid over each other with its arithmetic: nearest pixels,
blending in single precision. Only the files are read; the package is not imported.
"""

from __future__ import annotations

import functools
import importlib.util
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from smartplay_tools.games.crafter.facts import CARRIED, MATERIALS, MOST

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
    for table in (cells, carried):
        table.setflags(write=False)
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
    strength.setflags(write=False)
    return strength
