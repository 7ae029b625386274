"""Pictures of a scene, equal to those of PyPI `crafter` to the pixel, from a copy: looking changes nothing.

At Crafter's usual size, 64, the noise of the night is made of the numbers that the step has drawn. Larger pictures
show larger textures under the same grain. Every sum is rounded where the original and its imaging library round it.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from smartplay_tools.games.crafter.facts import AREA, ITEMS, MOST, VIEW, VITALS
from smartplay_tools.games.crafter.textures import LAYERS, tiles, vignette
from smartplay_tools.games.crafter.views import Scene
from smartplay_tools.pictures.png import joined_tiles

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


def draw(scene: Scene, size: int = USUAL) -> NDArray[np.uint8]:
    """Draw a square picture; the array is rows x columns x red, green and blue."""
    unit = size // GRID
    border = (size - unit * GRID) // 2
    picture = np.zeros((size, size, 3), np.uint8)
    inside = slice(border, border + unit * GRID)
    picture[inside, inside] = joined_tiles(*draw_cells(scene, unit)).transpose(1, 2, 0)
    return picture


class Cells(NamedTuple):
    """The cells of a picture: each that looks different once, and where they stand."""

    planes: NDArray[np.uint8]
    """Red, green and blue of each cell, of its rows, of its columns."""
    places: NDArray[np.intp]
    """By row and column of cells, which cell stands there."""


def draw_cells(scene: Scene, unit: int) -> Cells:
    """Draw the cells of a picture, `unit` pixels wide and high: the view, and below it what is carried."""
    view, carried = _view(scene, unit), _carried(scene, unit)
    places = np.concatenate((view.places, carried.places + view.planes.shape[1]))
    return Cells(np.concatenate((view.planes, carried.planes), axis=1), places)


def cells_seen(scene: Scene) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Materials (0: outside the map) and the things on them (`textures.LAYERS`), by column and row of the view."""
    columns, rows = VIEW
    left, top = scene.position[0] - columns // 2, scene.position[1] - rows // 2
    ground = np.frombuffer(scene.ground, np.uint8).reshape(AREA, AREA)
    if 0 <= left <= AREA - columns and 0 <= top <= AREA - rows:
        materials = ground[left : left + columns, top : top + rows]
    else:
        wider = np.pad(ground, columns)
        materials = wider[left + columns : left + 2 * columns, top + columns : top + columns + rows]
    layers = np.zeros(VIEW, np.uint8)
    for texture, (x, y) in scene.things:
        if 0 <= x - left < columns and 0 <= y - top < rows:
            layers[x - left, y - top] = LAYERS.index(texture)
    return materials, layers


class _Tables(NamedTuple):
    """Planes (red, green, blue) of all cells, in one row."""

    cells: NDArray[np.uint8]
    """By material and layer."""
    faded: NDArray[np.uint8]
    """The same with the colours of the night."""
    carried: NDArray[np.uint8]
    """By vital or item and amount."""


@functools.lru_cache(4)
def _tables(unit: int) -> _Tables:
    cells, carried = (
        np.ascontiguousarray(table.reshape(-1, 3, unit, unit).transpose(1, 0, 2, 3)) for table in tiles(unit)
    )
    return _Tables(cells, _faded(cells), carried)


def _view(scene: Scene, unit: int) -> Cells:
    materials, layers = (cells.T for cells in cells_seen(scene))
    codes = materials.astype(np.intp) * len(LAYERS) + layers
    tables = _tables(unit)
    if scene.daylight < 0.5:
        rows, columns = codes.shape
        seen = _in_colour(lit(joined_tiles(tables.cells, codes), scene), scene)
        cells = seen.reshape(3, rows, unit, columns, unit).transpose(0, 1, 3, 2, 4)
        return Cells(cells.reshape(3, -1, unit, unit), np.arange(codes.size).reshape(codes.shape))
    # By day equal cells look alike, so each is lit once.
    different = sorted(set(codes.ravel().tolist()))
    places = np.empty(different[-1] + 1, np.intp)
    places[different] = np.arange(len(different))
    cells, faded = (table.take(different, axis=1) for table in (tables.cells, tables.faded))
    return Cells(_in_colour(_mixed(cells, faded, scene.daylight), scene), places[codes])


def _in_colour(seen: NDArray[np.float64], scene: Scene) -> Planes:
    return asleep(seen) if scene.sleeping else seen.astype(np.uint8)


def _carried(scene: Scene, unit: int) -> Cells:
    amounts = [scene.inventory[name] for name in (*VITALS, *ITEMS)]
    places = np.zeros((GRID - VIEW[1], GRID), np.intp)  # the first is empty
    places.flat[: len(amounts)] = np.arange(1, len(amounts) + 1)
    shown = [0, *(number * (MOST + 1) + amount for number, amount in enumerate(amounts))]
    return Cells(_tables(unit).carried.take(shown, axis=1), places)


def lit(planes: Planes, scene: Scene) -> NDArray[np.float64]:
    """The view with the light of its time of day."""
    daylight = scene.daylight
    dark = _with_grain(planes, 2 * (0.5 - daylight), scene.grain) if daylight < 0.5 else planes
    return _mixed(planes, _faded(dark), daylight)


def _mixed(planes: Planes, faded: Planes, daylight: float) -> NDArray[np.float64]:
    seen: NDArray[np.float64] = daylight * planes + (1 - daylight) * _tinted(faded, NIGHT)
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
