"""Pictures of compiled worlds at Crafter's usual size: a faster `pictures.draw` with equal pixels."""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from smartplay_tools.games.crafter.compiled.ground import thing_at
from smartplay_tools.games.crafter.compiled.jit import kernel
from smartplay_tools.games.crafter.compiled.layout import KEY
from smartplay_tools.games.crafter.compiled.twister import temper, to_double, twist
from smartplay_tools.games.crafter.compiled.views import number_of_direction
from smartplay_tools.games.crafter.facts import (
    ARROW,
    CARRIED,
    COW,
    NIGHT_PIXELS,
    PLAYER,
    RIPE,
    SKELETON,
    VIEW,
    ZOMBIE,
)
from smartplay_tools.games.crafter.pictures import (
    BRIGHTEST_GRAIN,
    DARKEST_GRAIN,
    GRID,
    LUMA,
    NIGHT,
    SATURATION,
    SLEEP,
    UNIT,
    USUAL,
)
from smartplay_tools.games.crafter.textures import LAYERS, tiles, vignette
from smartplay_tools.games.crafter.world import COLUMN, CORNER

_COLUMNS, _ROWS = VIEW
_WIDTH, _HEIGHT = _COLUMNS * UNIT, _ROWS * UNIT
_RED, _GREEN, _BLUE = LUMA
_HALF_NIGHT = np.array(NIGHT) * 0.5
_HALF_SLEEP = np.array(SLEEP) * 0.5
_PLAYER_LAYER, _ARROW_LAYER = LAYERS.index("player-left"), LAYERS.index("arrow-left")
_ASLEEP, _PLANT_LAYER, _RIPE_LAYER = (LAYERS.index(name) for name in ("player-sleep", "plant", "plant-ripe"))
_COW_LAYER, _ZOMBIE_LAYER, _SKELETON_LAYER = (LAYERS.index(name) for name in ("cow", "zombie", "skeleton"))


class Tables(NamedTuple):
    """The tables that drawing uses."""

    cells: NDArray[np.uint8]
    carried: NDArray[np.uint8]
    vignette: NDArray[np.float64]


@functools.cache
def tables() -> Tables:
    """The tables, computed once per process."""
    of_cells = tiles(UNIT)
    return Tables(of_cells.cells, of_cells.carried, vignette(_WIDTH, _HEIGHT).ravel())


class Scratch(NamedTuple):
    """Buffers for drawing one picture."""

    planes: NDArray[np.uint8]
    dark: NDArray[np.uint8]
    grain: NDArray[np.float64]
    key: NDArray[np.uint32]


@kernel
def scratch() -> Any:
    """New buffers for pictures."""
    return Scratch(
        np.empty((3, NIGHT_PIXELS), np.uint8),
        np.empty((3, NIGHT_PIXELS), np.uint8),
        np.empty(NIGHT_PIXELS),
        np.empty(KEY, np.uint32),
    )


@kernel
def _layer(world: Any, things: Any, near: Any, at: int) -> int:
    """The thing on the ground of a cell, as a number in `LAYERS`."""
    shown = world.surface[at]
    if shown < PLAYER:
        return 0
    if shown == PLAYER:
        return _ASLEEP if world.sleeping else _PLAYER_LAYER + number_of_direction(world.facing)
    if shown == COW:
        return _COW_LAYER
    if shown == ZOMBIE:
        return _ZOMBIE_LAYER
    if shown == SKELETON:
        return _SKELETON_LAYER
    thing = things[thing_at(world, things, near, at)]
    if shown == ARROW:
        return _ARROW_LAYER + number_of_direction(thing.heading)
    return _RIPE_LAYER if thing.clock > RIPE else _PLANT_LAYER


@kernel
def _lay_out(world: Any, things: Any, near: Any, cells: Any, planes: Any) -> None:
    """Draw the view by day, without the light."""
    corner = world.at - CORNER
    for x in range(_COLUMNS):
        for y in range(_ROWS):
            at = corner + x * COLUMN + y
            tile = cells[world.ground[at], _layer(world, things, near, at)]
            for colour in range(3):
                for row in range(UNIT):
                    start = (y * UNIT + row) * _WIDTH + x * UNIT
                    for column in range(UNIT):
                        planes[colour, start + column] = tile[colour, row, column]


@kernel
def _draw_grain(world: Any, key: Any, grain: Any) -> None:
    """Repeat the night's draws; they go by columns of the view, and `grain` is by rows."""
    for i in range(KEY):
        key[i] = world.night_key[i]
    word = world.night_word
    for column in range(_WIDTH):
        for row in range(_HEIGHT):
            if word >= KEY:
                twist(key)
                word = 0
            first = temper(key[word])
            word += 1
            if word >= KEY:
                twist(key)
                word = 0
            grain[row * _WIDTH + column] = to_double(first, temper(key[word]))
            word += 1


@kernel
def _darken(planes: Any, dark: Any, grain: Any, amount: float, vignette: Any) -> None:
    """Darken the view, with the noise of the night."""
    for pixel in range(NIGHT_PIXELS):
        strength = amount * vignette[pixel]
        noise = strength * (DARKEST_GRAIN + (BRIGHTEST_GRAIN - DARKEST_GRAIN) * grain[pixel])
        for colour in range(3):
            dark[colour, pixel] = np.uint8(np.int32((1 - strength) * planes[colour, pixel] + noise))


@kernel
def _brightness(red: Any, green: Any, blue: Any) -> Any:
    return np.int32((red * _RED + green * _GREEN + blue * _BLUE + 0x8000) >> 16)


@kernel
def _light(planes: Any, dark: Any, daylight: float) -> None:
    """Apply the light of the time of day to the view."""
    for pixel in range(NIGHT_PIXELS):
        grey = _brightness(np.int32(dark[0, pixel]), np.int32(dark[1, pixel]), np.int32(dark[2, pixel]))
        for colour in range(3):
            difference = np.float32(np.int32(dark[colour, pixel]) - grey)
            faded = np.int32(np.float32(grey) + SATURATION * difference)
            night = 0.5 * faded + _HALF_NIGHT[colour]
            planes[colour, pixel] = np.uint8(np.int32(daylight * planes[colour, pixel] + (1 - daylight) * night))


@kernel
def _close_eyes(planes: Any) -> None:
    """Apply the colours of sleep to the view."""
    for pixel in range(NIGHT_PIXELS):
        grey = _brightness(np.int32(planes[0, pixel]), np.int32(planes[1, pixel]), np.int32(planes[2, pixel]))
        for colour in range(3):
            planes[colour, pixel] = np.uint8(np.int32(0.5 * grey + _HALF_SLEEP[colour]))


@kernel
def draw(world: Any, things: Any, near: Any, light: Any, tables: Any, room: Any, picture: Any) -> None:
    """Draw a world into `picture`, an array of rows x columns x (red, green, blue)."""
    planes, daylight = room.planes, light[world.steps].daylight
    _lay_out(world, things, near, tables.cells, planes)
    if light[world.steps].night:
        _draw_grain(world, room.key, room.grain)
        _darken(planes, room.dark, room.grain, 2 * (0.5 - daylight), tables.vignette)
        _light(planes, room.dark, daylight)
    else:
        _light(planes, planes, daylight)
    if world.sleeping:
        _close_eyes(planes)
    for row in range(USUAL):
        for column in range(USUAL):
            for colour in range(3):
                picture[row, column, colour] = 0
    for row in range(_HEIGHT):
        for column in range(_WIDTH):
            for colour in range(3):
                picture[row, column, colour] = planes[colour, row * _WIDTH + column]
    for item in range(len(CARRIED)):
        left, top = item % GRID * UNIT, _HEIGHT + item // GRID * UNIT
        amount = world.inventory[item]
        if amount:
            for row in range(UNIT):
                for column in range(UNIT):
                    for colour in range(3):
                        picture[top + row, left + column, colour] = tables.carried[item, amount, colour, row, column]
