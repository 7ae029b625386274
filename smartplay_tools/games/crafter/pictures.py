"""Pictures of a scene, equal to those of PyPI `crafter` to the pixel, from a copy: looking changes nothing.

At Crafter's usual size, 64, the noise of the night is made of the numbers that the step has drawn. Larger pictures
show larger textures under the same grain. Every sum is rounded where the original and its imaging library round it.

The pictures of single cells in every combination that can be seen, computed once and then looked up.

The textures are the image files of PyPI `crafter`, scaled and laid over each other with its arithmetic: nearest pixels,
blending in single precision. Only the files are read; the package is not imported.
"""

from __future__ import annotations

import functools
import importlib.util
from collections.abc import Sequence
from operator import itemgetter
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from smartplay_tools.games.crafter.facts import CARRIED, MATERIALS, MOST, VIEW
from smartplay_tools.games.crafter.views import Scene
from smartplay_tools.types.pictures import Picture
from smartplay_tools.types.png import Canvas, EncodedTiles, Layout, layout_of

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
"""Red, green and blue, each rows by columns; or first by cell."""


_FIRST_LAYER = bytes(range(0, len(LAYERS) * (len(MATERIALS) + 1), len(LAYERS))).ljust(256)
"""By material (0: outside the map), the number of a cell with nothing on it."""
_LAYER = {texture: number for number, texture in enumerate(LAYERS)}
_IN_ORDER = itemgetter(*CARRIED)
"""The amounts of an inventory."""


def draw(scene: Scene, size: int = USUAL) -> NDArray[np.uint8]:
    """Draw a square picture; the array is rows x columns x red, green and blue."""
    unit = size // GRID
    border = (size - unit * GRID) // 2
    picture = np.zeros((size, size, 3), np.uint8)
    inside = slice(border, border + unit * GRID)
    if scene.daylight < 0.5:
        view = _by_night(scene, unit)
    else:
        different, places = np.unique(np.frombuffer(numbers_seen(scene), np.uint8), return_inverse=True)
        view = _by_day(different.tolist(), scene, unit).take(places, axis=0)
    cells = np.concatenate((view, _amounts(unit, [scene.inventory[name] for name in CARRIED])))
    picture[inside, inside] = _joined(cells, GRID).transpose(1, 2, 0)
    return picture


def encode(scene: Scene, unit: int, scale: int) -> Picture:
    """Return the picture that a model is shown: its cells have `unit` pixels and are enlarged `scale` times."""
    layout = layout_of(GRID, GRID, unit, unit, scale)
    if scene.daylight < 0.5:
        view = layout.encoded(_by_night(scene, unit))
    else:
        view = _seen_by_day(scene.daylight, scene.sleeping, layout).tiles(numbers_seen(scene), scene, unit)
    return layout.picture(_with_amounts(layout, unit, *_IN_ORDER(scene.inventory)), view)


class _EncodedCells(NamedTuple):
    """Encoded cells."""

    numbers: bytes
    """What they are (`numbers_seen`)."""
    places: bytes
    """By number, where they are in `tiles`."""
    tiles: EncodedTiles


class _Light:
    """The cells that were shown in one light by day: in it equal ones look alike, and are encoded once."""

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        self._cells: _EncodedCells | None = None
        """Replaced as a whole, since episodes in several threads share it."""

    def tiles(self, numbers: bytes, scene: Scene, unit: int) -> EncodedTiles:
        """Return cells by their numbers."""
        cells = self._cells
        if cells is None or numbers.translate(None, cells.numbers):
            # What was shown in another light will be shown in this one, too; ten cells take little longer than one.
            shown = _ever_shown(self._layout)
            shown.update(numbers)
            asked = bytes(sorted(shown))
            places = bytes.maketrans(asked, bytes(range(len(asked))))
            encoded = self._layout.encoded(_by_day([*asked], scene, unit))
            self._cells = cells = _EncodedCells(asked, places, encoded)
        return cells.tiles.take(np.frombuffer(numbers.translate(cells.places), np.uint8))


@functools.lru_cache(512)
def _seen_by_day(daylight: float, sleeping: bool, layout: Layout) -> _Light:
    """The cells in a light, which at a step is the same in every world."""
    return _Light(layout)


@functools.lru_cache(16)
def _ever_shown(layout: Layout) -> set[int]:
    """The numbers of the cells that were shown by day."""
    return set()


@functools.lru_cache(128)
def _with_amounts(layout: Layout, unit: int, *amounts: int) -> Canvas:
    """The picture without the view: what is below it rarely changes from step to step."""
    return layout.begun(layout.encoded(_amounts(unit, amounts)), VIEW[1])


def _amounts(unit: int, amounts: Sequence[int]) -> NDArray[np.uint8]:
    """The cells below the view: amounts of vitals and items, and nothing in the others."""
    shown = [number * (MOST + 1) + amount for number, amount in enumerate(amounts)]
    nothing = [0] * (GRID * (GRID - VIEW[1]) - len(shown))
    return _tables(unit).carried.take(shown + nothing, axis=0)


def numbers_seen(scene: Scene) -> bytes:
    """The cells of the view, row by row: `len(LAYERS)` times the material, and the thing on it (its layer)."""
    ground, rows = scene.ground, VIEW[1]
    numbers = bytearray(ground.translate(_FIRST_LAYER))
    for texture, column, row in scene.things:
        at = column * rows + row
        numbers[at] = _FIRST_LAYER[ground[at]] + _LAYER[texture]
    return b"".join([numbers[row::rows] for row in range(rows)])


def cells_seen(scene: Scene) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Materials (0: outside the map) and the things on them (`textures.LAYERS`), by row and column of the view."""
    numbers = np.frombuffer(numbers_seen(scene), np.uint8).reshape(VIEW[::-1])
    return np.divmod(numbers, np.uint8(len(LAYERS)))


class _Tables(NamedTuple):
    """All cells by number: planes of red, green and blue, each rows by columns."""

    cells: NDArray[np.uint8]
    faded: NDArray[np.float64]
    """The same in the colours of the night."""
    carried: NDArray[np.uint8]
    """By vital or item and amount."""


@functools.lru_cache(4)
def _tables(unit: int) -> _Tables:
    cells, carried = (np.ascontiguousarray(table.reshape(-1, 3, unit, unit)) for table in tiles(unit))
    faded = _tinted(_faded(cells.swapaxes(0, 1)), NIGHT).swapaxes(0, 1)
    return _Tables(cells, np.ascontiguousarray(faded), carried)


def _by_day(numbers: Sequence[int], scene: Scene, unit: int) -> NDArray[np.uint8]:
    """Cells by their numbers: by day equal ones look alike."""
    cells, faded = (table.take(numbers, axis=0) for table in (_tables(unit).cells, _tables(unit).faded))
    seen = scene.daylight * cells + (1 - scene.daylight) * faded
    return asleep(seen.swapaxes(0, 1)).swapaxes(0, 1) if scene.sleeping else seen.astype(np.uint8)


def _by_night(scene: Scene, unit: int) -> NDArray[np.uint8]:
    """Every cell of the view, row by row: the noise is not the same in any two."""
    columns, rows = VIEW
    cells = _tables(unit).cells.take(np.frombuffer(numbers_seen(scene), np.uint8), axis=0)
    seen = lit(_joined(cells, columns), scene)
    shown = asleep(seen) if scene.sleeping else seen.astype(np.uint8)
    return shown.reshape(3, rows, unit, columns, unit).transpose(1, 3, 0, 2, 4).reshape(-1, 3, unit, unit)


def _joined(cells: NDArray[np.uint8], across: int) -> Planes:
    """The planes of the picture that cells make, row by row."""
    number, _, unit, _ = cells.shape
    laid = cells.reshape(-1, across, 3, unit, unit).transpose(2, 0, 3, 1, 4)
    return laid.reshape(3, number // across * unit, across * unit)


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
    tinted: NDArray[np.float64] = 0.5 * planes.reshape(len(planes), -1) + _halved(colour)
    return tinted.reshape(3, *planes.shape[1:])


@functools.cache
def _halved(colour: tuple[int, int, int]) -> NDArray[np.float64]:
    half: NDArray[np.float64] = 0.5 * np.array(colour)[:, None]
    return half
