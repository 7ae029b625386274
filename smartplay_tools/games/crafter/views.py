"""The views that an engine gives of its world: a `Sight` for the text, a `Scene` for pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from smartplay_tools.games.crafter.facts import AREA, ARROW, ITEMS, NAMES, PLANT, RIPE, VIEW, VITALS
from smartplay_tools.games.crafter.world import DIRECTIONS


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
    """The material of each cell, column by column."""
    things: Sequence[tuple[str, tuple[int, int]]]
    """Texture and position of the player and of all things in the view, at least, in the order in which they are drawn.
    """
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


class CrafterEngine(Protocol):
    """A world that can be played. Both engines are built as `CrafterEngine(seed, episode, keep_grain=...)`."""

    steps: int
    """Steps since the world began."""

    @property
    def health(self) -> int:
        """The player's health; at 0 it is dead."""
        ...

    @property
    def unlocked(self) -> int:
        """How many achievements have been unlocked."""
        ...

    def step(self, action: int) -> float:
        """Play an action; return the reward."""
        ...

    def sight(self) -> Sight:
        """The part of the state that the observation text describes."""
        ...

    def scene(self) -> Scene:
        """The part of the state that a picture shows."""
        ...

    def state(self) -> Any:
        """The whole state except the random stream, as JSON; the same in every engine."""
        ...

    def fingerprint(self) -> bytes:
        """The state of the random stream."""
        ...


OUTSIDE = "."
"""The letter that `surroundings` writes for a cell outside the map."""


def surroundings(scene: Scene) -> dict[str, Any]:
    """The cells that the player sees, as JSON.

    `ground` has a letter for each cell, row by row: a for the first of `facts.MATERIALS`, b for the second and so on.
    `things` are (texture, column, row), in the order in which they are drawn; `carried` are vitals and items.
    """
    columns, rows = VIEW
    left, top = scene.position[0] - columns // 2, scene.position[1] - rows // 2
    ground = "".join(_letter(scene.ground, x, y) for y in range(top, top + rows) for x in range(left, left + columns))
    things = [
        [texture, x - left, y - top]
        for texture, (x, y) in scene.things
        if 0 <= x - left < columns and 0 <= y - top < rows
    ]
    carried = [scene.inventory[name] for name in (*VITALS, *ITEMS)]
    # Three digits are more than anybody can see.
    light = {"daylight": round(scene.daylight, 3), "sleeping": scene.sleeping}
    return {"ground": ground, "things": things, "carried": carried, "at": list(scene.position), **light}


def _letter(ground: bytes, x: int, y: int) -> str:
    inside = 0 <= x < AREA and 0 <= y < AREA
    return chr(ord("a") + ground[x * AREA + y] - 1) if inside else OUTSIDE
