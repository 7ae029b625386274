"""The games in a labyrinth, of which only the squares around the player are seen.

POPGym's authors write that agents without a memory solve these well; they are here because a map is what a long context
is used for. The view of POPGym is cut at the outer wall, so the words are those of the labyrinth itself.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from smartplay_tools.errors import extra_named

with extra_named("A game of POPGym", "popgym"):
    from popgym.core.maze import MazeEnv
    from popgym.envs.labyrinth_escape import LabyrinthEscape as LabyrinthEscapeEnv
    from popgym.envs.labyrinth_explore import LabyrinthExplore as LabyrinthExploreEnv

from smartplay_popgym.game import PopgymGame

WORDS = ("a path", "a wall", "the start", "the exit")
"""Of the squares, in POPGym's order."""
WALL = 1
MARKS = " #SE.#SE"
"""Of the squares in a drawing, in the same order, and of those that were visited."""
STEPS = 1024


class Labyrinth(PopgymGame):
    """A labyrinth of `side` by `side` squares."""

    uses_global_streams = True  # mazelib
    actions = ("Left", "Right", "Up", "Down")
    env_class: ClassVar[type[MazeEnv]]

    def __init__(self, *, side: int, **options: Any) -> None:
        self.side = side
        self._place: tuple[int, int] | None = None
        self._walled: list[list[int]] = []
        """The squares, with a wall around them."""
        super().__init__(**options)

    def make_env(self) -> MazeEnv:
        """The environment of POPGym."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # what this module's docstring says
            return self.env_class(maze_dims=(self.side, self.side), episode_length=STEPS)

    def describe(self, observation: Any, info: Mapping[str, Any]) -> str:
        """Whether the player moved, and the four squares around."""
        if not self.played:
            self._walled = np.pad(self.env.maze.grid, 1, constant_values=WALL).tolist()
        place, before = self.env.position, self._place
        self._place = place
        moved = "" if not self.played else "A wall is in the way. " if place == before else "You move on. "
        return moved + " ".join(
            f"{name}: {WORDS[square]}." for name, square in zip(self.actions, self._around(), strict=True)
        )

    @property
    def breaks(self) -> Sequence[int]:
        """The ways that a wall blocks."""
        return [action for action, square in enumerate(self._around()) if square == WALL]

    def drawing(self) -> dict[str, Any]:
        """The labyrinth as characters: the player, the squares that were visited, the start and the exit."""
        squares = zip(self.env.maze.grid, self.env.explored, strict=True)
        rows = [[MARKS[cell + 4 * seen] for cell, seen in zip(*row, strict=True)] for row in squares]
        y, x = self.env.position
        rows[y][x] = "@"
        return {"text": "\n".join("".join(row) for row in rows)}

    def _around(self) -> tuple[int, ...]:
        """The squares to which the actions lead."""
        y, x = self.env.position
        above, beside, below = self._walled[y : y + 3]
        return beside[x], beside[x + 2], above[x + 1], below[x + 1]


class LabyrinthExplore(Labyrinth):
    """Visit every square."""

    manual = (
        "You are in a labyrinth, of which you see the four squares around you. Visit every square of its paths. A new "
        "square adds to your score, and every other step takes a little away."
    )
    env_class = LabyrinthExploreEnv


class LabyrinthEscape(Labyrinth):
    """Find the exit."""

    manual = (
        "You are in a labyrinth, of which you see the four squares around you. Find the exit, which is in the outer "
        "wall. It adds a point to your score, and every step takes a little away."
    )
    env_class = LabyrinthEscapeEnv
