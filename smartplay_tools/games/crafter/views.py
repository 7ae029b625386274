"""What an engine shows of its world: to the text a sight, to the pictures a scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray


class Sight(NamedTuple):
    """What the text tells about."""

    surface: bytes | bytearray
    """What each cell shows, laid out as in `world`."""
    at: int
    facing: int
    inventory: Mapping[str, int]
    """Vitals and items, in their order."""
    sleeping: bool


class Scene(NamedTuple):
    """What a picture shows."""

    ground: bytes
    """The material of each cell, column by column."""
    things: Sequence[tuple[str, tuple[int, int]]]
    """Texture and position of the player and of all things, in the order in which they are drawn."""
    position: tuple[int, int]
    inventory: Mapping[str, int]
    sleeping: bool
    daylight: float
    grain: NDArray[np.float64] | None
    """The night's draws from [0, 1) in the order of the picture's pixels; None by day."""


class Engine(Protocol):
    """A world that can be played. Both engines are built as `Engine(seed, episode, keep_grain=...)`."""

    steps: int
    """Steps since the world began."""

    @property
    def health(self) -> int:
        """The player's health; without any it is dead."""
        ...

    @property
    def unlocked(self) -> int:
        """How many achievements have been unlocked."""
        ...

    def step(self, action: int) -> float:
        """Play an action; return the reward."""
        ...

    def sight(self) -> Sight:
        """What the text tells about."""
        ...

    def scene(self) -> Scene:
        """What a picture shows."""
        ...

    def state(self) -> Any:
        """The whole state but the random stream, as JSON; the same in every engine."""
        ...

    def fingerprint(self) -> bytes:
        """The state of the random stream."""
        ...
