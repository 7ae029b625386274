"""A room of MiniGrid, in words and as a picture of what the player sees."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from importlib.metadata import version
from typing import Any

import gymnasium

from smartplay_tools.errors import extra_named
from smartplay_tools.games import GymnasiumGame
from smartplay_tools.types.pictures import Picture

os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")  # a print to stdout may be read as a server's answer
with extra_named("A game of MiniGrid", "minigrid"):
    import minigrid  # noqa: F401  # registers the environments
    from minigrid.core.constants import IDX_TO_COLOR, IDX_TO_OBJECT, STATE_TO_IDX
    from minigrid.envs.babyai.core import roomgrid_level

vars(roomgrid_level)["print"] = lambda *_: None  # BabyAI prints when it draws a world again

UNNAMED = ("unseen", "empty", "wall", "floor")
"""What is not worth a word."""
DOORS = {number: state for state, number in STATE_TO_IDX.items()}
TILE = 24
"""The pixels of a square in a picture."""


class RoomGame(GymnasiumGame):
    """An environment of MiniGrid, named by its id."""

    uses_global_streams = False
    env: Any
    picture_engines = (None,)
    actions = ("Turn left", "Turn right", "Go forward", "Pick up", "Drop", "Toggle", "Done")
    manual = (
        "You are in a grid of rooms, and see the part of it that lies before you: seven squares deep and seven wide, "
        "as far as no wall is in the way. Do what the task says. You pick up, drop and toggle what is in the square in "
        "front of you; a toggle opens and closes a door, and one that is locked only with a key of its color. The "
        "score is 1 for the task, less a part for every step that it took, and 0 without it."
    )

    def __init__(self, *, env: str, **options: Any) -> None:
        """`env` is the id of the environment in MiniGrid."""
        self.env_id = env
        super().__init__(**options)

    def make_env(self) -> gymnasium.Env[Any, Any]:
        """The environment of MiniGrid, without Gymnasium's wrappers."""
        return gymnasium.make(self.env_id).unwrapped

    def describe(self, observation: Mapping[str, Any], info: Mapping[str, Any]) -> str:
        """The task, the things in view with their places, and what is in front."""
        carried = self.env.carrying
        hands = "nothing" if carried is None else f"the {carried.color} {carried.type}"
        seen = "; ".join(_things(observation["image"])) or "nothing"
        front = observation["image"][len(observation["image"]) // 2, -2]
        return (
            f"Task: {observation['mission']}. You see {seen}. In front of you: {_thing(front) or 'nothing'}. "
            f"You carry {hands}."
        )

    @property
    def picture_shape(self) -> tuple[int, int]:
        """Width and height in pixels."""
        side = self.env.agent_view_size * TILE
        return side, side

    def picture(self) -> Picture:
        """What the player sees, from above; it looks up."""
        return Picture.from_array(self.env.get_pov_render(TILE))

    def drawing(self) -> dict[str, Any]:
        """The whole grid as characters, as MiniGrid prints it."""
        return {"text": self.env.pprint_grid()}

    def versions(self) -> Mapping[str, str]:
        """The version of MiniGrid, which makes the worlds."""
        return {"minigrid": version("minigrid")}


def _things(image: Any) -> Iterator[str]:
    """Yield the things in view; the player is in the middle of the last row, and looks along the columns."""
    middle, last = len(image) // 2, len(image) - 1
    for across, column in enumerate(image):
        for down, square in enumerate(column):
            thing = _thing(square)
            if thing is None or thing == "a wall" or (across, down) == (middle, last):
                continue
            ahead, side = last - down, across - middle
            places = [f"{ahead} ahead"] if ahead else []
            places += [f"{abs(side)} to the {'left' if side < 0 else 'right'}"] if side else []
            yield f"{thing} {' and '.join(places)}"


def _thing(square: Any) -> str | None:
    """Return a square in words; None if nothing is there."""
    kind, color, state = (int(number) for number in square)
    name = IDX_TO_OBJECT[kind]
    if name in UNNAMED:
        return "a wall" if name == "wall" else None
    described = f"{IDX_TO_COLOR[color]} {name}"
    if name == "door":
        described = f"{DOORS[state]} {described}"
    return f"an {described}" if described[0] in "aeiou" else f"a {described}"
