"""The views that an engine gives of its world: a `Sight` for the text, a `Scene` for pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from smartplay_tools.games.crafter.facts import ARROW, CARRIED, NAMES, PLANT, RIPE, VIEW
from smartplay_tools.games.crafter.world import DIRECTIONS

CENTER = VIEW[0] // 2, VIEW[1] // 2
"""Column and row of the player in its view."""


class Sight(NamedTuple):
    """The part of the state that the observation text describes."""

    surface: bytes | bytearray
    """The id that each cell shows, laid out as in `world`."""
    at: int
    facing: int
    inventory: Mapping[str, int]
    """Vitals and items, in their order."""
    sleeping: bool


class Scene(NamedTuple):
    """The part of the state that a picture shows."""

    ground: bytes
    """The material of each cell of the view, column by column; 0 beyond the map."""
    things: Sequence[tuple[str, int, int]]
    """Texture, column and row of the player and of all things in the view, in the order in which they are drawn."""
    position: tuple[int, int]
    inventory: Mapping[str, int]
    sleeping: bool
    daylight: float
    grain: NDArray[np.float64] | None
    """The night's draws from [0, 1) in the order of the picture's pixels; None by day."""


_SIDES = dict(zip(DIRECTIONS, ("left", "right", "up", "down"), strict=True))


def body_texture(facing: int, *, sleeping: bool) -> str:
    """The texture of the player."""
    return "player-sleep" if sleeping else f"player-{_SIDES[facing]}"


def thing_texture(kind: int, clock: int, heading: int) -> str:
    """The texture of a thing."""
    if kind == ARROW:
        return f"arrow-{_SIDES[heading]}"
    return "plant-ripe" if kind == PLANT and clock > RIPE else NAMES[kind]


OUTSIDE = "."
"""The letter that `surroundings` writes for a cell outside the map."""


def surroundings(scene: Scene) -> dict[str, Any]:
    """The cells that the player sees, as JSON.

    `ground` has a letter for each cell, row by row: a for the first of `facts.MATERIALS`, b for the second and so on.
    `things` are (texture, column, row), in the order in which they are drawn; `carried` are vitals and items.
    """
    by_row = (material for row in range(VIEW[1]) for material in scene.ground[row :: VIEW[1]])
    ground = "".join(chr(ord("a") + material - 1) if material else OUTSIDE for material in by_row)
    things = [list(thing) for thing in scene.things]
    carried = [scene.inventory[name] for name in CARRIED]
    # Three digits are more than anybody can see.
    light = {"daylight": round(scene.daylight, 3), "sleeping": scene.sleeping}
    return {"ground": ground, "things": things, "carried": carried, "at": list(scene.position), **light}
